"""Reading of YAML files as plain values, and as nodes with their positions."""

import io
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, StringMark, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError
from ruamel.yaml.tokens import AnchorToken, TagToken

from rigcast.sensors.errors import InputError
from rigcast.sensors.faults import Fault, Where, path_text

from .limits import require_extent, shallow_tokens
from .places import Placed, error_at, nearest, placed

_INCLUDED = "; a file is built on with `extends: FILE`"
_INDENT = re.compile(r"\s*")
_CORE = {f"tag:yaml.org,2002:{kind}" for kind in ("null", "bool", "int", "float", "str")}


@dataclass(frozen=True)
class YamlFile:
    """A YAML file: its content as dicts, lists and scalars, and the positions of everything in it.

    texts: of every source from which `root` has nodes, by name; the first is the file itself, by its path.
    """

    path: Path
    texts: Mapping[str, str]
    root: Node
    content: Any

    def error(self, faults: Iterable[Fault]) -> InputError:
        """One error that shows every fault, in the order of the text."""
        return error_at(self.texts, [placed(nearest(self.root, fault), str(fault)) for fault in faults])

    def folder(self, where: Where) -> Path:
        """The folder of the file in which the value at `where` is written; the working directory for no file."""
        source = nearest(self.root, Fault(where, "")).start_mark.name
        return Path(source).parent if source in self.texts and Path(source).is_file() else Path()


def read_yaml(path: Path) -> YamlFile:
    """Read one YAML 1.2 document as plain values; no other objects are ever made from it.

    Raises InputError for a file that cannot be read or parsed, and for tags and duplicate keys, all at once.
    """
    text = _read_text(path)
    root, content = parse_yaml(str(path), text)
    return YamlFile(path, {str(path): text}, root, content)


def parse_yaml(source: str, text: str, shown: str | None = None) -> tuple[Node, Any]:
    """The nodes and the content of one document. source: its name in marks and errors. Raises as `read_yaml`.

    shown: text with the same lines and columns that errors show in place of the document.
    """
    texts = {source: text if shown is None else shown}
    try:
        refused = _refused(source, text)
        root = _yaml().compose(_stream(source, text))
    except MarkedYAMLError as error:
        mark, problem = _problem(error, text)
        raise error_at(texts, [Placed(source, mark.line, mark.column, f"not valid YAML: {problem}")]) from None
    except ReaderError as error:
        message = f"not valid YAML: got the character U+{error.character:04X}, expected printable text"
        raise error_at(texts, [Placed(source, *_line_and_column(text[: error.position]), message)]) from None
    if root is None:
        raise InputError(f"{source}: the file is empty")
    require_extent(source, root)
    reader = _Reader(refused)
    content = reader.value(root, ())
    if reader.faults:
        raise error_at(texts, reader.faults)
    return root, content


def _problem(error: MarkedYAMLError, text: str) -> tuple[StringMark, str]:
    """The place of what the parser could not read, and what is wrong with it."""
    mark, problem = error.problem_mark or error.context_mark, error.problem or ""
    if problem.startswith("found unexpected end of stream") and "quoted" in (error.context or ""):
        return error.context_mark, "the text that begins here has no closing quotation mark"
    if problem.startswith("could not find expected ':'"):
        return error.context_mark, "expected a key and its value, with a colon and a space between them"
    lines = text.splitlines()
    indent = _INDENT.match(lines[mark.line]) if mark.line < len(lines) else None
    strange = [sign for sign in indent.group() if sign != " "] if indent else []
    if problem.startswith("found character '\\t'"):
        return mark, "got a tab, expected spaces as indentation"
    if strange and problem.startswith("expected <block end>"):
        return mark, f"got the character U+{ord(strange[0]):04X}, expected spaces as indentation"
    return mark, _in_words(error)


def _in_words(error: MarkedYAMLError) -> str:
    """The parser's problem, and the beginning of what it was reading."""
    problem, context = error.problem or "", error.context or ""
    if problem.startswith("but "):
        return f"{context}, {problem}"
    start, end = error.context_mark, error.problem_mark
    begun = f", which begins at {start.line + 1}:{start.column + 1}" if start and end and start.line != end.line else ""
    if problem.startswith("expected <block end>") and "start>" in problem:
        return f"not indented like the rest of its mapping or list{begun}"
    return " ".join(part for part in (problem, context) if part) + begun


def content_of(root: Node) -> Any:
    """The plain values of nodes without faults from `parse_yaml`."""
    return _Reader([]).value(root, ())


class _Reader:
    """Converts nodes to plain values and notes what is not allowed in a file."""

    def __init__(self, faults: list[Placed]) -> None:
        self.faults = faults
        self._constructor = _yaml().constructor
        self._known: dict[Node, Any] = {}
        self._open: set[Node] = set()

    def value(self, node: Node, where: Where) -> Any:
        """The value of a node; a node with aliases is read once."""
        if node in self._open:
            self._note(node, where, "contains itself")
            return None
        if node not in self._known:
            self._open.add(node)
            self._known[node] = self._read(node, where)
            self._open.remove(node)
        return self._known[node]

    def _read(self, node: Node, where: Where) -> Any:
        if isinstance(node, MappingNode):
            return self._mapping(node, where)
        if isinstance(node, SequenceNode):
            return [self.value(item, (*where, i)) for i, item in enumerate(node.value)]
        return self._scalar(node, where) if str(node.tag) in _CORE else node.value

    def _scalar(self, node: Node, where: Where) -> Any:
        try:
            return self._constructor.construct_object(node)
        except (ValueError, YAMLError) as error:
            self._note(node, where, f"cannot be read: {error}")
            return None

    def _mapping(self, node: MappingNode, where: Where) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = str(key_node.value)
            if not isinstance(key_node, ScalarNode):
                self._note(key_node, where, "a key must be text")
            elif key in values:
                first = next(other for other, _ in node.value if str(other.value) == key)
                message = f"duplicate key {key!r}, which stands in line {first.start_mark.line + 1} already"
                self._note(key_node, (*where, key), message)
            elif key == "<<":
                self._note(
                    key_node, where, "got a merge key <<, which is not of YAML 1.2; expected the keys themselves"
                )
            values[key] = self.value(value_node, (*where, key))
        return values

    def _note(self, node: Node, where: Where, message: str) -> None:
        place = path_text(where)
        self.faults.append(placed(node, f"{place}: {message}" if place else message))


def _yaml() -> YAML:
    yaml = YAML(typ="safe", pure=True)
    yaml.composer.warn_double_anchors = False  # `_refused` reports where
    return yaml


def _stream(source: str, text: str) -> io.StringIO:
    """The text as a stream with a name, which appears in its marks."""
    stream = io.StringIO(text)
    stream.name = source
    return stream


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        before = error.object[: error.start].decode("utf-8", "replace")
        line, column = _line_and_column(before)
        wrong = f"byte {error.start} is 0x{error.object[error.start]:02X}"
        raise InputError(f"{path}:{line + 1}:{column + 1}: not UTF-8 text: {wrong}; expected YAML in UTF-8") from None


def _line_and_column(before: str) -> tuple[int, int]:
    """Line and column, from 0, of what follows this text."""
    return before.count("\n"), len(before) - before.rfind("\n") - 1


def _refused(source: str, text: str) -> list[Placed]:
    """Faults for tags, and for anchors that hide another one of the same name."""
    anchors = set[str]()
    refused = []
    for token in shallow_tokens(_yaml(), text):
        message = None
        if isinstance(token, TagToken):
            name = "".join(part or "" for part in token.value)
            message = f"got the tag {name}, expected a plain value{_INCLUDED if 'include' in name else ''}"
        elif isinstance(token, AnchorToken) and token.value in anchors:
            message = f"got the anchor &{token.value} a second time, expected another name"
        elif isinstance(token, AnchorToken):
            anchors.add(token.value)
        if message is not None:
            refused.append(Placed(source, token.start_mark.line, token.start_mark.column, message))
    return refused
