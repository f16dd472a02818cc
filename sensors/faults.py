"""Mistakes in specifications: one `Fault` per mistake, with its place and a sentence.

pydantic finds the mistakes; this module rewords its reports. The same faults serve
Python, where they are lines of an `InputError`, and YAML, where each is given its line and column.
"""

import math
import reprlib
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import NoneType
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from .errors import InputError
from .names import expected_one_of, listing

Where = tuple[str | int, ...]

MOST_SHOWN = 100
"""Faults of which an error shows a line each."""
_KINDS_WITH_MEANING = ("float_type", "int_type", "int_from_float", "tuple_type", "string_pattern_mismatch")
_MAPPING_KINDS = ("model_type", "model_attributes_type", "dict_type")


@dataclass(frozen=True)
class Fault:
    """One mistake: its place `where` (keys and indices, outermost first) and what is wrong.

    `at_key` says that the key itself is at fault, not its value.
    """

    where: Where
    message: str
    at_key: bool = False

    def __str__(self) -> str:
        place = path_text(self.where)
        return f"{place}: {self.message}" if place else self.message

    def under(self, *prefix: str | int) -> "Fault":
        """The fault with its place prefixed by the keys and indices that lead to its specification."""
        return Fault((*prefix, *self.where), self.message, self.at_key)


def path_text(where: Where) -> str:
    """`("sensors", 0, "mount")` as `sensors[0].mount`."""
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in where).lstrip(".")


def refuse(owner: str, faults: Iterable[Fault]) -> None:
    """Raise one InputError with a line per fault, each beginning with `owner`; do nothing without faults."""
    lines = [f"{owner}: {fault}" for fault in faults]
    if lines:
        raise InputError("\n".join(lines[:MOST_SHOWN] + others(len(lines))))


def others(faults: int) -> list[str]:
    """The line about those of so many faults that are not shown, if there are any."""
    return [f"... and {faults - MOST_SHOWN} more"] if faults > MOST_SHOWN else []


def faults_of(error: ValidationError, spec: type[BaseModel]) -> list[Fault]:
    """The faults that pydantic found in data for `spec`."""
    return list(dict.fromkeys(_fault(detail, spec) for detail in error.errors(include_url=False)))


def _fault(detail: ErrorDetails, spec: type[BaseModel]) -> Fault:
    where, owner, annotation, kin = _resolve(spec, detail["loc"])
    kind, given = detail["type"], detail["input"]
    if kind == "extra_forbidden" and owner is not None:
        key = str(where[-1])
        place = _level_of(key, spec, detail["loc"], owner)
        if place:
            return Fault(where, f"unknown key {key!r}, which belongs {place}", True)
        others = [tag for tag, model in kin.items() if key in model.model_fields]
        theirs = f", which {listing(others)} {'has' if len(others) == 1 else 'have'}" if others else ""
        return Fault(where, f"unknown key {key!r}{theirs}, {expected_one_of(key, _own_first(owner, kin))}", True)
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return _tag_fault(where, given, list(_union_members(annotation)))
    if kind in ("too_long", "too_short"):
        return Fault(where, _length_message(detail))
    if kind == "missing" and isinstance(where[-1], int):
        values = get_args(_resolve(spec, detail["loc"][:-1])[2])
        return Fault(where[:-1], f"must have {len(values)} values, got {len(given)}")
    if kind == "missing":
        return Fault(where, "required, but not given")
    if kind == "value_error":
        return Fault(where, str(detail["ctx"]["error"]))
    keys = _keys(annotation) if kind in _MAPPING_KINDS else ""
    return Fault(where, f"{_sentence(detail)}{keys}, got {_shown(given)}{_meaning(kind, where, owner)}")


def _level_of(key: str, spec: type[BaseModel], loc: Where, owner: type[BaseModel]) -> str:
    """Where a key belongs that is one level too high or too low, as by wrong indentation; "" if that is not it."""
    inner = {name: _without_none(field.annotation) for name, field in owner.model_fields.items()}
    models = {
        name: inside for name, inside in inner.items() if isinstance(inside, type) and issubclass(inside, BaseModel)
    }
    below = [repr(name) for name, model in models.items() if key in model.model_fields]
    if below:
        return f"in {' or '.join(below)}"
    around, outer = _resolve(spec, loc[:-1])[:2]
    beside = outer is not None and outer is not owner and key in outer.model_fields and isinstance(around[-1], str)
    return f"beside {around[-1]!r}, not in it" if beside else ""


def _own_first(owner: type[BaseModel], kin: Mapping[str, type[BaseModel]]) -> list[str]:
    """The keys of a model, with those that all of its kin have last."""
    shared = set(owner.model_fields).intersection(*(model.model_fields for model in kin.values())) if kin else set()
    return sorted(owner.model_fields, key=lambda key: key in shared)


def _resolve(
    spec: type[BaseModel], loc: Where
) -> tuple[Where, type[BaseModel] | None, Any, dict[str, type[BaseModel]]]:
    """Follow pydantic's `loc` through the annotations of `spec`.

    pydantic puts the tag of a discriminated union into `loc` although no such key is in the data. It is told apart
    from a key by its position, right below the union, because a key may have the same name. Returns the
    place without tags, the model that has its last key, the annotation found there, and tag -> model of the union
    that this model belongs to, if it does.
    """
    where: list[str | int] = []
    owner: type[BaseModel] | None = None
    annotation: Any = spec
    union: dict[str, type[BaseModel]] = {}
    kin: dict[str, type[BaseModel]] = {}
    for step in loc:
        members = _union_members(annotation)
        if members:
            annotation, union = members.get(str(step)), members
            continue
        where.append(step)
        kin, union = union, {}
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            owner, field = annotation, annotation.model_fields.get(str(step))
            annotation = _without_none(field.annotation) if field else None
        else:
            annotation = next(iter(get_args(annotation)), None)
    return tuple(where), owner, annotation, kin


def _without_none(annotation: Any) -> Any:
    """The annotation without None: `X` for `X | None`."""
    some = [member for member in get_args(annotation) if member is not NoneType]
    return some[0] if NoneType in get_args(annotation) and len(some) == 1 else annotation


def _union_members(annotation: Any) -> dict[str, type[BaseModel]]:
    """The models of a union discriminated on `type`, by their tags; empty for any other annotation."""
    if get_origin(annotation) is not Annotated:
        return {}
    models = get_args(get_args(annotation)[0])
    return {get_args(model.model_fields["type"].annotation)[0]: model for model in models}


def _tag_fault(where: Where, given: Any, tags: Sequence[str]) -> Fault:
    if "type" not in given:
        return Fault((*where, "type"), f"required, one of {', '.join(tags)}")
    return Fault((*where, "type"), f"unknown type {given['type']!r}, {expected_one_of(str(given['type']), tags)}")


def _length_message(detail: ErrorDetails) -> str:
    context = detail["ctx"]
    if "max_length" in context:
        return f"must have at most {context['max_length']} values, got {len(detail['input'])}"
    return f"must have at least {context['min_length']} value(s), got {len(detail['input'])}"


def _sentence(detail: ErrorDetails) -> str:
    kind = detail["type"]
    if kind in _MAPPING_KINDS:
        return "must be a mapping"
    if kind == "bool_type":
        return "must be true or false"
    if kind in ("tuple_type", "sequence_str", "is_instance_of"):
        return "must be a list"
    if kind == "string_pattern_mismatch":
        return f"must match {detail['ctx']['pattern']}"
    told = detail["msg"].replace("Input should be", "must be").replace("String should have", "must have")
    return told.replace("a valid ", "a ").replace("a int", "an int")


def _keys(annotation: Any) -> str:
    """The text " of <keys>" for a mapping whose keys are known, else ""."""
    is_model = isinstance(annotation, type) and issubclass(annotation, BaseModel)
    return f" of {listing(list(annotation.model_fields))}" if is_model else ""


def _meaning(kind: str, where: Where, owner: type[BaseModel] | None) -> str:
    """The field's description, with its unit, if a number or list was expected; else ""."""
    key = next((step for step in reversed(where) if isinstance(step, str)), None)
    if kind not in _KINDS_WITH_MEANING or owner is None or key not in owner.model_fields:
        return ""
    return f" ({owner.model_fields[key].description})"


def _shown(value: Any) -> str:
    """A value for the message: shortened, with text in quotes."""
    if value is None:
        return "nothing (null)"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, int) and value.bit_length() > 1000:  # Python refuses to write out far longer ones
        return f"an integer of {value.bit_length()} bits"
    shown = reprlib.repr(list(value) if isinstance(value, tuple) else value)
    return shown + _look_alikes(value) if isinstance(value, str) else shown


def _look_alikes(text: str) -> str:
    """The names of signs such as a typeset minus, which look like those of a keyboard; else ""."""
    signs = dict.fromkeys(sign for sign in text if not sign.isascii() and not sign.isalnum())
    names = [f"U+{ord(sign):04X} {unicodedata.name(sign, '')}".rstrip() for sign in signs]
    return f" with {', '.join(names[:3])}" if names else ""
