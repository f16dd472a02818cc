"""YAML files as plain values, with the line and column of each, so that a fault can be pointed at."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.tokens import (
    BlockEndToken,
    BlockMappingStartToken,
    BlockSequenceStartToken,
    DirectiveToken,
    FlowMappingEndToken,
    FlowMappingStartToken,
    FlowSequenceEndToken,
    FlowSequenceStartToken,
    TagToken,
    Token,
)

from .errors import InputError
from .faults import Fault, Where, path_text

_CORE = {f"tag:yaml.org,2002:{kind}" for kind in ("null", "bool", "int", "float", "str")}
_DEEPEST = 50  # levels of lists and mappings; parsers need time and stack without bound for more
_MOST_VALUES = 100_000  # with what aliases stand for; nine lines of aliases of aliases can stand for a billion
_OPENING = (BlockMappingStartToken, BlockSequenceStartToken, FlowMappingStartToken, FlowSequenceStartToken)
_CLOSING = (BlockEndToken, FlowMappingEndToken, FlowSequenceEndToken)


@dataclass(frozen=True)
class YamlFile:
    """A YAML file: its content as dicts, lists and scalars, and where in the text everything is."""

    path: Path
    text: str
    root: Node
    content: Any

    def error(self, faults: Iterable[Fault]) -> InputError:
        """One error that shows every fault in the text, in its order."""
        return _error(self.path, self.text, [(*_place(self.root, fault), str(fault)) for fault in faults])


def read_yaml(path: Path) -> YamlFile:
    """Read one YAML 1.2 document; nothing but plain values is ever made from it.

    Raises InputError for a file that cannot be read or parsed, and for tags and duplicate keys, all of them.
    """
    text = _read_text(path)
    try:
        tags = _tags(text)
        root = _yaml().compose(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        about = " ".join(part for part in (error.problem, error.context) if part)
        raise _error(path, text, [(mark.line, mark.column, f"not valid YAML: {about}")]) from None
    except YAMLError as error:
        raise InputError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from None
    if root is None:
        raise InputError(f"{path}: the file is empty")
    values, depth = _extent(root, {})
    if values > _MOST_VALUES or depth > _DEEPEST:
        raise InputError(f"{path}: its aliases stand for more than {_MOST_VALUES} values or nest over {_DEEPEST} deep")
    reader = _Reader(tags)
    content = reader.value(root, ())
    if reader.faults:
        raise _error(path, text, reader.faults)
    return YamlFile(path, text, root, content)


_Placed = tuple[int, int, str]  # line and column from 0, and the message


class _Reader:
    """Turns nodes into plain values and notes what may not be in a file."""

    def __init__(self, faults: list[_Placed]) -> None:
        self.faults = faults
        self._constructor = _yaml().constructor
        self._known: dict[Node, Any] = {}

    def value(self, node: Node, where: Where) -> Any:
        """The value of a node; a node that is referred to by aliases is read once."""
        if node not in self._known:
            self._known[node] = None  # what a node that contains itself finds inside
            self._known[node] = self._read(node, where)
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
                self._note(key_node, (*where, key), f"duplicate key {key!r}")
            values[key] = self.value(value_node, (*where, key))
        return values

    def _note(self, node: Node, where: Where, message: str) -> None:
        mark = node.start_mark
        place = path_text(where)
        self.faults.append((mark.line, mark.column, f"{place}: {message}" if place else message))


def _yaml() -> YAML:
    return YAML(typ="safe", pure=True)


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text: byte {error.start}") from None


def _tags(text: str) -> list[_Placed]:
    tokens = [token for token in _shallow_tokens(text) if isinstance(token, TagToken)]
    message = "got a tag, expected a plain value"
    return [(token.start_mark.line, token.start_mark.column, message) for token in tokens]


def _shallow_tokens(text: str) -> Iterator[Token]:
    """The tokens of a text; an error where it is of another version, and where it is nested too deeply."""
    depth = 0
    for token in _yaml().scan(text):
        if isinstance(token, DirectiveToken) and token.name == "YAML" and token.value != (1, 2):
            version = ".".join(map(str, token.value))
            raise MarkedYAMLError(problem=f"got version {version}, expected 1.2", problem_mark=token.start_mark)
        depth += isinstance(token, _OPENING) - isinstance(token, _CLOSING)
        if depth > _DEEPEST:
            raise MarkedYAMLError(problem=f"nested more than {_DEEPEST} deep", problem_mark=token.start_mark)
        yield token


def _extent(node: Node, known: dict[Node, tuple[int, int]]) -> tuple[int, int]:
    """How many values a node is and how deep, itself included, if every alias were written out."""
    if node not in known:
        known[node] = 1, 1  # what a node that contains itself counts inside
        inner = [_extent(value, known) for _, _, value in _entries(node)]
        known[node] = 1 + sum(values for values, _ in inner), 1 + max((depth for _, depth in inner), default=0)
    return known[node]


def _place(root: Node, fault: Fault) -> tuple[int, int]:
    """Line and column, from 0, of a fault, or of what surrounds it where the text does not have it."""
    key, node = root, root
    for step in fault.where:
        found = _child(node, step)
        if found is None:
            return node.start_mark.line, node.start_mark.column
        key, node = found
    # An empty value has no place of its own: `mount:` is shown at its key.
    mark = key.start_mark if fault.at_key or node.start_mark.index == node.end_mark.index else node.start_mark
    return mark.line, mark.column


def _child(node: Node, step: str | int) -> tuple[Node, Node] | None:
    """Key and value of an entry; an item of a list is its own key."""
    return next(((key, value) for name, key, value in _entries(node) if name == step), None)


def _entries(node: Node) -> Iterator[tuple[str | int, Node, Node]]:
    if isinstance(node, MappingNode):
        yield from ((str(key.value), key, value) for key, value in node.value)
    elif isinstance(node, SequenceNode):
        yield from ((i, item, item) for i, item in enumerate(node.value))


def _error(path: Path, text: str, placed: list[_Placed]) -> InputError:
    return InputError("\n".join(_shown(path, text, *each) for each in sorted(placed)))


def _shown(path: Path, text: str, line: int, column: int, message: str) -> str:
    """`path:line:col: message`, with the line of the file below it and a caret under the column."""
    lines = text.splitlines()
    source = lines[line].replace("\t", " ") if line < len(lines) else ""
    return f"{path}:{line + 1}:{column + 1}: {message}\n    {source}\n    {' ' * column}^"
