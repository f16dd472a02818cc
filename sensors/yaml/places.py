"""Positions of nodes in YAML files, and errors that show them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from ruamel.yaml.nodes import MappingNode, Node, SequenceNode

from rigcast.sensors.errors import InputError
from rigcast.sensors.faults import MOST_SHOWN, Fault, others

_WIDEST = 400  # characters of a line that an error shows


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
    """One error that shows the faults in the texts, in their order: place and message, line, caret.

    Of very many only the first are shown, and the number of the others.
    """
    order = list(texts)
    ordered = sorted(faults, key=lambda fault: (order.index(fault.source), *fault[1:]))
    lines = {source: text.splitlines() for source, text in texts.items()}
    shown = [_shown(lines[fault.source], fault) for fault in ordered[:MOST_SHOWN]]
    return InputError("\n".join(shown + others(len(ordered))))


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
    if isinstance(node, SequenceNode) and isinstance(step, int):  # maybe one of very many
        return (node.value[step], node.value[step]) if step < len(node.value) else None
    return next(((key, value) for name, key, value in entries(node) if name == step), None)


def _shown(lines: Sequence[str], fault: Placed) -> str:
    """`source:line:col: message`, with the line of the text below it and a caret under the column; of a very long line
    the part around it."""
    line = lines[fault.line].replace("\t", " ") if fault.line < len(lines) else ""
    start = max(0, fault.column - _WIDEST // 2) if len(line) > _WIDEST else 0
    place = f"{fault.source}:{fault.line + 1}:{fault.column + 1}"
    return f"{place}: {fault.message}\n    {line[start : start + _WIDEST]}\n    {' ' * (fault.column - start)}^"
