"""Rig files in layers: what a file extends, sensors that are repeated, and values set from the shell.

Layers are merged as nodes, which know their positions in the text: a fault of the resulting rig is
shown in the file, or the `--set`, from which it comes.
"""

import string
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.specs.presets import preset_names
from rigcast.sensors.yaml.file import YamlFile, content_of, read_yaml
from rigcast.sensors.yaml.limits import MOST_VALUES, require_extent
from rigcast.sensors.yaml.places import Placed, entries, error_at, placed

from .overrides import assigned, read_assignments

_MODELS = (".xml", ".mjcf", ".urdf", ".mjb")  # files that are given by mistake in place of a rig
_MOST_FILES = 100  # most files from which one rig is made
_STRING = "tag:yaml.org,2002:str"
_NAMED = ("props", "sensors")  # lists of named items


def read_layers(path: Path, overrides: Sequence[str]) -> YamlFile:
    """A rig file with everything that it extends, its repeated sensors written out, and `KEY=VALUE` overrides.

    `extends: base.yaml`, or a list of files, later ones on top, lays the file over others: mappings are merged key
    by key, sensors and props name by name, anything else is replaced. `repeat: {side: [left, right]}` in a sensor
    gives a copy of it for each of these values, put in place of `$side` wherever that stands in the sensor.

    Raises InputError for a model or a device in place of a rig, and for a file that cannot be read; also, all of them
    at once, for files that extend themselves, placeholders without values, and overrides of what is not there.
    """
    if isinstance(overrides, str) or not isinstance(overrides, Sequence):
        raise InputError(f"overrides: got {overrides!r:.80}, expected a list such as ['sensors.top.rate_hz=5']")
    refuse_other_names(path)
    layers = _Layers()
    root = layers.file(path, ())
    if overrides:
        texts, assignments = read_assignments(overrides)
        layers.texts |= texts
        for assignment in assignments:
            root = assigned(root, assignment, layers.faults)
    if layers.faults:
        raise error_at(layers.texts, layers.faults)
    require_extent(str(path), root)
    return YamlFile(path, layers.texts, root, content_of(root))


def refuse_other_names(path: Path) -> None:
    """Raise InputError for names that are not of YAML files: models and devices."""
    if path.suffix in _MODELS:
        raise InputError(f"{path}: a MuJoCo model, expected a rig file; `rigcast init {path}` writes one")
    device = path.stem.lower()
    if device in preset_names() and not path.exists():
        how = f"`rigcast presets {device}` shows it, and a sensor of a rig names it: `preset: {device}`"
        raise InputError(f"{path}: the name of a device, expected a rig file; {how}")


class _Layers:
    """The texts from which a rig is read, and the faults of their references to each other."""

    def __init__(self) -> None:
        self.texts: dict[str, str] = {}
        self.faults: list[Placed] = []
        self._files = 0

    def file(self, path: Path, extended_by: tuple[Path, ...]) -> Node:
        """The nodes of a file merged over those of the files that it extends."""
        document = read_yaml(path)
        self.texts |= document.texts
        own = self._written_out(document.root)
        layers = [self._base(path, item, (*extended_by, path)) for item in _bases(document.root)]
        base: Node | None = None
        for layer in (*(layer for layer in layers if layer is not None), own):
            base = layer if base is None else merged(base, layer)
        return own if base is None else base

    def _base(self, path: Path, item: Node, chain: tuple[Path, ...]) -> Node | None:
        base = path.parent / item.value
        self._files += 1
        if base.resolve() in [link.resolve() for link in chain]:
            self._note(item, f"extends: {' -> '.join(map(str, (*chain, base)))} is a circle")
        elif not base.is_file():
            device = f"; a sensor has a device as `preset: {item.value}`" if item.value in preset_names() else ""
            self._note(item, f"extends: {base} is not a file{device}")
        elif self._files > _MOST_FILES:
            self._note(item, f"extends: got more than {_MOST_FILES} files")
        else:
            return _without(self.file(base, chain), "extends")
        return None

    def _written_out(self, root: Node) -> Node:
        """The nodes of a file with one sensor for each row of a `repeat`."""
        if not isinstance(root, MappingNode):
            return root
        return _like(root, [(key, self._all_copies(key, value)) for key, value in root.value])

    def _all_copies(self, key: Node, items: Node) -> Node:
        if key.value not in _NAMED or not isinstance(items, SequenceNode):
            return items
        return _like(items, [copy for item in items.value for copy in self._copies(item)])

    def _copies(self, item: Node) -> Iterator[Node]:
        repeat = _value(item, "repeat")
        if repeat is None:
            yield item
            return
        template = _without(item, "repeat")
        for row in self._rows(repeat, template):
            yield self._filled(template, row)

    def _rows(self, repeat: Node, template: Node) -> list[dict[str, Node]]:
        """The values of every copy, by name."""
        columns = {str(name): value for name, _, value in entries(repeat)}
        lengths = {name: len(value.value) for name, value in columns.items() if isinstance(value, SequenceNode)}
        if not isinstance(repeat, MappingNode) or len(lengths) < len(columns) or not any(lengths.values()):
            self._note(repeat, "repeat: must be names with lists of values, such as {side: [left, right]}")
            return []
        count = max(lengths.values())
        if min(lengths.values()) < count:
            counts = ", ".join(f"{length} of {name}" for name, length in lengths.items())
            self._note(repeat, f"repeat: must be lists of equal length, got {counts}")
            return []
        longest = max(len(list(_scalars(item))) for value in columns.values() for item in value.value)
        if count * longest * len(list(_scalars(template))) > MOST_VALUES:
            self._note(repeat, f"repeat: stands for more than {MOST_VALUES} values")
            return []
        return [{name: value.value[k] for name, value in columns.items()} for k in range(count)]

    def _filled(self, node: Node, row: Mapping[str, Node]) -> Node:
        """A copy of a node with the row's values in place of `$name`; one that stands alone keeps its kind."""
        if isinstance(node, MappingNode):
            return _like(node, [(key, self._filled(value, row)) for key, value in node.value])
        if isinstance(node, SequenceNode):
            return _like(node, [self._filled(item, row) for item in node.value])
        template = string.Template(node.value)
        if str(node.tag) != _STRING or "$" not in node.value or not self._names_are_known(node, template, row):
            return node
        alone = row.get(node.value.removeprefix("$").removeprefix("{").removesuffix("}"))
        if alone is not None and node.value[0] == "$" and len(template.get_identifiers()) == 1:
            return type(alone)(alone.tag, alone.value, node.start_mark, node.end_mark)
        for name in template.get_identifiers():
            if not isinstance(row[name], ScalarNode):
                self._note(node, f"{node.value!r}: ${name} stands for a list or mapping, expected it alone")
                return node
        text = template.substitute({name: value.value for name, value in row.items()})
        return ScalarNode(node.tag, text, node.start_mark, node.end_mark)

    def _names_are_known(self, node: Node, template: string.Template, row: Mapping[str, Node]) -> bool:
        if not template.is_valid():
            self._note(node, f"{node.value!r}: a $ must be followed by a name of repeat, or by another $")
            return False
        unknown = [name for name in template.get_identifiers() if name not in row]
        for name in unknown:
            self._note(node, f"no ${name} in repeat, {expected_one_of(name, list(row))}")
        return not unknown

    def _note(self, node: Node, message: str) -> None:
        fault = placed(node, message)
        if fault not in self.faults:  # each copy of a sensor has it
            self.faults.append(fault)


def merged(base: Node, over: Node) -> Node:
    """`over` merged over `base`: mappings key by key, lists of named items name by name; anything else is replaced."""
    if isinstance(base, MappingNode) and isinstance(over, MappingNode):
        return _like(over, _merged_pairs(base.value, over.value))
    below, above = _by_name(base), _by_name(over)
    return over if below is None or above is None else _like(over, [item for _, item in _merged_pairs(below, above)])


_Pairs = Sequence[tuple[Node, Node]]


def _merged_pairs(base: _Pairs, over: _Pairs) -> list[tuple[Node, Node]]:
    """Keys and values of both, those of the base first. A key that is twice in `over` stays twice, to be refused."""
    above = {key.value: (key, value) for key, value in reversed(over)}
    below = {key.value for key, _ in base}
    pairs = [(key, value) if key.value not in above else _laid(value, *above[key.value]) for key, value in base]
    taken: set[str] = set()
    for key, value in over:
        if key.value not in below or key.value in taken:
            pairs.append((key, value))
        taken.add(key.value)
    return pairs


def _laid(below: Node, key: Node, value: Node) -> tuple[Node, Node]:
    return key, merged(below, value)


def _by_name(node: Node) -> _Pairs | None:
    """Names and items of a list whose items all have names; None for anything else."""
    if not isinstance(node, SequenceNode):
        return None
    pairs = [(_value(item, "name"), item) for item in node.value]
    named = [(name, item) for name, item in pairs if isinstance(name, ScalarNode)]
    return named if len(named) == len(pairs) else None


def _bases(root: Node) -> Sequence[Node]:
    """The names of the extended files; anything else is reported by the rig's own check."""
    extends = _value(root, "extends")
    items = extends.value if isinstance(extends, SequenceNode) else [extends]
    return [item for item in items if isinstance(item, ScalarNode) and str(item.tag) == _STRING]


def _value(node: Node, key: str) -> Node | None:
    return next((value for name, _, value in entries(node) if name == key), None)


def _without(node: Node, key: str) -> Node:
    return _like(node, [pair for pair in node.value if pair[0].value != key]) if _value(node, key) else node


def _like(node: Node, value: list[Node] | list[tuple[Node, Node]]) -> Node:
    """A node with another value at the position of this one."""
    return type(node)(node.tag, value, node.start_mark, node.end_mark)


def _scalars(node: Node) -> Iterator[Node]:
    inner = [value for _, _, value in entries(node)]
    yield from (scalar for value in inner for scalar in _scalars(value))
    if isinstance(node, ScalarNode):
        yield node
