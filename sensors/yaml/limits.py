"""What a YAML file may be: of version 1.2, and so large and deep that it is read in little time and stack."""

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
    Token,
)

from rigcast.sensors.errors import InputError

from .places import entries

_DEEPEST = 50  # levels of lists and mappings
MOST_VALUES = 100_000  # with what aliases stand for; nine lines of aliases of aliases can stand for a billion
_OPENING = (BlockMappingStartToken, BlockSequenceStartToken, FlowMappingStartToken, FlowSequenceStartToken)
_CLOSING = (BlockEndToken, FlowMappingEndToken, FlowSequenceEndToken)


def require_extent(source: str, root: Node) -> None:
    """Raise InputError for nodes that stand for too much, every alias written out."""
    values, depth = _extent(root, {})
    if values > MOST_VALUES or depth > _DEEPEST:
        raise InputError(f"{source}: its aliases stand for more than {MOST_VALUES} values or nest over {_DEEPEST} deep")


def shallow_tokens(yaml: YAML, text: str) -> Iterator[Token]:
    """The tokens of a text; an error where it is of another version, and where it is nested too deeply."""
    depth = 0
    for token in yaml.scan(text):
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
        inner = [_extent(value, known) for _, _, value in entries(node)]
        known[node] = 1 + sum(values for values, _ in inner), 1 + max((depth for _, depth in inner), default=0)
    return known[node]
