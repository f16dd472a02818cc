"""The JSON schemas of rig files, with `extends` and `repeat`, and of data set files."""

from typing import Any

from .dataset.description.file import DatasetFile
from .rig_file.file import RigFile

_DRAFT = "https://json-schema.org/draft/2020-12/schema"

_FILLED = ("number", "integer", "boolean", "array", "object")
_REPEAT = {
    "type": "object",
    "minProperties": 1,
    "additionalProperties": {"type": "array", "minItems": 1, "items": True},
    "description": "names with lists of values of equal length: one copy per value, with $name replaced by it",
}
# With `extends` any key may be left to the extended file; sensors are then matched by their names.
_PART = {"type": "object", "required": ["name"], "properties": {"name": {"type": "string"}}}


def rig_schema() -> dict[str, Any]:
    """JSON schema, draft 2020-12, of a rig file.

    A file that extends another may omit keys that the other has. A repeated sensor may have `$name` for a
    value that is no text.
    """
    document = RigFile.model_json_schema()
    required, lists = document.pop("required"), {}
    for key in ("props", "sensors"):
        lists[key] = {"items": document["properties"][key].pop("items")}
    for definition in document["$defs"].values():
        _allow_placeholders(definition["properties"])
        if "name" in definition["properties"]:
            definition["properties"]["repeat"] = _REPEAT
            definition["properties"]["name"]["pattern"] = "^[A-Za-z0-9_${}-]+$"
        else:
            definition |= _or_text(definition)
    return {
        "$schema": _DRAFT,
        **document,
        "if": {"required": ["extends"]},
        "then": {"properties": {key: {"items": _PART} for key in lists}},
        "else": {"required": required, "properties": lists},
    }


def dataset_schema() -> dict[str, Any]:
    """JSON schema, draft 2020-12, of the file of a data set."""
    return {"$schema": _DRAFT, **DatasetFile.model_json_schema()}


def _allow_placeholders(schema: Any) -> None:
    """Allow text that contains $ for every value that is no text; limits apply to the value, a pattern to text."""
    if isinstance(schema, list):
        for item in schema:
            _allow_placeholders(item)
    elif isinstance(schema, dict):
        if schema.get("type") in _FILLED:
            schema |= _or_text(schema)
        for value in schema.values():
            _allow_placeholders(value)


def _or_text(schema: dict[str, Any]) -> dict[str, Any]:
    return {"type": [schema["type"], "string"], "pattern": r"\$"}
