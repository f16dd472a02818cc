"""Positions of nodes in YAML files, and errors that show them."""

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from ruamel.yaml.nodes import MappingNode, Node, SequenceNode

from rigcast.sensors.errors import InputError
from rigcast.sensors.faults import Fault


class Placed(NamedTuple):
    """A message and its position: a source, and line and column of its text, counted from 0."""

    source: str
    line: int
    column: int
    message: str


def placed(node: Node, message: str) -> Placed:
    """A message at the position of a node."""
    return Placed(node.start_mark.name, node.start_mark.line, node.start_mark.column, message)


def error_at(texts: Mapping[str, str], faults: Iterable[Placed]) -> InputError:
    """One error that shows every fault in the texts, in their order: place and message, line, caret."""
    order = list(texts)
    ordered = sorted(faults, key=lambda fault: (order.index(fault.source), *fault[1:]))
    return InputError("\n".join(_shown(texts[fault.source], fault) for fault in ordered))


def entries(node: Node) -> Iterator[tuple[str | int, Node, Node]]:
    """(name, key, value) of the entries of a mapping or list; an item of a list is its own key."""
    if isinstance(node, MappingNode):
        yield from ((str(key.value), key, value) for key, value in node.value)
    elif isinstance(node, SequenceNode):
        yield from ((i, item, item) for i, item in enumerate(node.value))


def nearest(root: Node, fault: Fault) -> Node:
    """The node that a fault is about, or the one around it if it is missing in the text."""
    key, node = root, root
    for step in fault.where:
        found = _child(node, step)
        if found is None:
            return node
        key, node = found
    # An empty value has no position of its own: `mount:` is shown at its key.
    return key if fault.at_key or node.start_mark.index == node.end_mark.index else node


def _child(node: Node, step: str | int) -> tuple[Node, Node] | None:
    return next(((key, value) for name, key, value in entries(node) if name == step), None)


def _shown(text: str, fault: Placed) -> str:
    """`source:line:col: message`, with the line of the text below it and a caret under the column."""
    lines = text.splitlines()
    line = lines[fault.line].replace("\t", " ") if fault.line < len(lines) else ""
    place = f"{fault.source}:{fault.line + 1}:{fault.column + 1}"
    return f"{place}: {fault.message}\n    {line}\n    {' ' * fault.column}^"
