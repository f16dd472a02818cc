"""Overrides such as `--set sensors.top.rate_hz=5`: values that replace those of a rig's file."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ruamel.yaml.error import FileMark
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.yaml.file import parse_yaml
from rigcast.sensors.yaml.places import Placed, entries, placed

SOURCE = "--set"
_KEY = re.compile(r"[A-Za-z_][\w-]*(\.[\w*-]+|\[\d+\])*")
_MAP, _STRING = "tag:yaml.org,2002:map", "tag:yaml.org,2002:str"


@dataclass(frozen=True)
class Assignment:
    """A value and the steps that lead to it, each a scalar node: a key, the name of a sensor, an index, or `*`."""

    steps: tuple[ScalarNode, ...]
    value: Node


def read_assignments(overrides: Sequence[str]) -> tuple[dict[str, str], list[Assignment]]:
    """The text to show for faults, one override to a line, and the assignments.

    Raises InputError for an override that is not KEY=VALUE, or whose value is not YAML.
    """
    lines = [" ".join(override.splitlines()) for override in overrides]
    parts = [line.partition("=") for line in lines]
    wrong = [line for line, (key, _, value) in zip(lines, parts, strict=True) if not _KEY.fullmatch(key) or not value]
    if wrong:
        expected = "expected KEY=VALUE, such as sensors.top.rate_hz=5"
        raise InputError("\n".join(f"{SOURCE}: got {line!r}, {expected}" for line in wrong))
    late = [line for line, (key, _, _) in zip(lines, parts, strict=True) if re.match(r"extends\b", key)]
    if late:
        told = "values are set after files have been merged, expected `extends` in the file itself"
        raise InputError("\n".join(f"{SOURCE}: got {line!r}: {told}" for line in late))
    text = "\n".join(lines)
    assignments = []
    for number, (key, _, value) in enumerate(parts):
        steps = tuple(_step(number, match.start(), match[0]) for match in re.finditer(r"[^.\[\]]+", key))
        root, _ = parse_yaml(SOURCE, "\n" * number + " " * (len(key) + 1) + value, shown=text)
        assignments.append(Assignment(steps, root))
    return {SOURCE: text}, assignments


def _step(line: int, column: int, text: str) -> ScalarNode:
    start, end = (FileMark(SOURCE, at, line, at) for at in (column, column + len(text)))
    return ScalarNode(_STRING, text, start, end)


def assigned(root: Node, assignment: Assignment, faults: list[Placed]) -> Node:
    """The nodes with one value set; if its place does not exist, a fault is noted and they are unchanged."""
    try:
        return _set(root, assignment.steps, assignment.value)
    except _NotThereError as error:
        faults.append(error.fault)
        return root


class _NotThereError(Exception):
    def __init__(self, fault: Placed) -> None:
        super().__init__(fault.message)
        self.fault = fault


def _set(node: Node, steps: Sequence[ScalarNode], value: Node) -> Node:
    if not steps:
        return value
    if isinstance(node, SequenceNode):
        chosen = _chosen(node, steps[0])
        items = [_set(item, steps[1:], value) if k in chosen else item for k, item in enumerate(node.value)]
        return SequenceNode(node.tag, items, node.start_mark, node.end_mark)
    step, rest = steps[0], steps[1:]
    pairs = list(node.value) if isinstance(node, MappingNode) else []
    there = [k for k, (key, _) in enumerate(pairs) if key.value == step.value]
    if there:
        pairs[there[0]] = (step, _set(pairs[there[0]][1], rest, value))
    else:
        pairs.append((step, _set(ScalarNode(_STRING, "", step.start_mark, step.end_mark), rest, value)))
    place = node if isinstance(node, MappingNode) else step
    return MappingNode(_MAP, pairs, place.start_mark, place.end_mark)


def _chosen(items: SequenceNode, step: ScalarNode) -> list[int]:
    """Which items of a list a step means: all of them, one by its number, or one by its name."""
    count = len(items.value)
    if step.value == "*":
        return list(range(count))
    names = {
        str(value.value): k for k, item in enumerate(items.value) for key, _, value in entries(item) if key == "name"
    }
    if step.value in names:
        return [names[step.value]]
    if step.value.isdecimal() and int(step.value) < count:
        return [int(step.value)]
    known = list(names) or [str(k) for k in range(count)]
    if step.value.isdecimal():
        raise _NotThereError(placed(step, f"no item {step.value}, expected 0 to {count - 1}"))
    raise _NotThereError(placed(step, f"no item named {step.value!r}, {expected_one_of(step.value, known)}"))
