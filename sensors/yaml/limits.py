"""Limits of YAML files: version 1.2, and a size and depth that take little time and stack."""

from collections.abc import Iterator

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.nodes import Node
from ruamel.yaml.tokens import (
    BlockEndToken,
    BlockMappingStartToken,
    BlockSequenceStartToken,
    DirectiveToken,
    FlowMappingEndToken,
    FlowMappingStartToken,
    FlowSequenceEndToken,
    FlowSequenceStartToken,
    KeyToken,
    ScalarToken,
    Token,
)

from rigcast.sensors.errors import InputError

from .places import entries

_DEEPEST = 50  # levels of lists and mappings
MOST_VALUES = 100_000  # with aliases expanded; nine lines of nested aliases can expand to a billion
_OPENING = (BlockMappingStartToken, BlockSequenceStartToken, FlowMappingStartToken, FlowSequenceStartToken)
_CLOSING = (BlockEndToken, FlowMappingEndToken, FlowSequenceEndToken)


def require_extent(source: str, root: Node) -> None:
    """Raise InputError for nodes that exceed the limits with every alias expanded."""
    values, depth = _extent(root, {})
    if values > MOST_VALUES or depth > _DEEPEST:
        raise InputError(f"{source}: its aliases stand for more than {MOST_VALUES} values or nest over {_DEEPEST} deep")


def shallow_tokens(yaml: YAML, text: str) -> Iterator[Token]:
    """The tokens of a text; raises an error if it is of another version, nested too deeply or has too many values."""
    depth = values = 0
    for token in yaml.scan(text):
        if isinstance(token, DirectiveToken) and token.name == "YAML" and token.value != (1, 2):
            version = ".".join(map(str, token.value))
            raise MarkedYAMLError(problem=f"got version {version}, expected 1.2", problem_mark=token.start_mark)
        depth += isinstance(token, _OPENING) - isinstance(token, _CLOSING)
        if depth > _DEEPEST:
            raise MarkedYAMLError(problem=f"nested more than {_DEEPEST} deep", problem_mark=token.start_mark)
        values += isinstance(token, (ScalarToken, *_OPENING)) - isinstance(token, KeyToken)
        if values > MOST_VALUES:  # told here, because to read them all takes minutes
            told = f"got more than {MOST_VALUES} values; rays belong in a ray_file"
            raise MarkedYAMLError(problem=told, problem_mark=token.start_mark)
        yield token


def _extent(node: Node, known: dict[Node, tuple[int, int]]) -> tuple[int, int]:
    """Number of values and depth of a node, itself included, with every alias expanded."""
    if node not in known:
        known[node] = 1, 1  # the extent of a node within itself
        inner = [_extent(value, known) for _, _, value in entries(node)]
        known[node] = 1 + sum(values for values, _ in inner), 1 + max((depth for _, depth in inner), default=0)
    return known[node]
