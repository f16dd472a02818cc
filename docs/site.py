"""A hook of MkDocs that appends the YAML reference, from the schema of rig files, to its page."""

import json
from collections.abc import Iterator
from typing import Any

from rigcast.schema import rig_schema

_PAGE = "yaml.md"
_TITLES = {
    "Lidar": "Sensors of type lidar",
    "DepthCamera": "Sensors of type depth_camera",
    "HeightScan": "Sensors of type height_scan",
}


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Called by MkDocs for every page."""
    return markdown + yaml_reference() if page.file.src_path == _PAGE else markdown


def yaml_reference() -> str:
    """A table of keys for the file itself and for each kind of object in it."""
    schema = rig_schema()
    parts = {"The file": schema, **{_TITLES.get(name, name): part for name, part in schema["$defs"].items()}}
    return "".join(f"\n## {title}\n\n{_summary(part)}\n\n{_table(part)}\n" for title, part in parts.items())


def _summary(part: dict[str, Any]) -> str:
    return str(part.get("description", "")).partition("\n\n")[0].replace("\n", " ")


def _table(part: dict[str, Any]) -> str:
    required = set(part.get("required", ()))
    rows = [_row(key, value, key in required) for key, value in part["properties"].items()]
    return "\n".join(["| key | value | default | |", "|---|---|---|---|", *rows])


def _row(key: str, value: dict[str, Any], required: bool) -> str:
    default = "required" if required else _default(value)
    about = str(value.get("description", "")).replace("|", "\\|").replace("\n", " ")
    return f"| `{key}` | {' or '.join(dict.fromkeys(_kinds(value)))} | {default} | {about} |"


def _default(value: dict[str, Any]) -> str:
    """The default as written in a file; empty for an object, whose defaults are in its own table."""
    return f"`{json.dumps(value['default'])}`" if not isinstance(value.get("default", {}), dict) else ""


def _kinds(value: dict[str, Any]) -> Iterator[str]:
    """The types and constants that a value may be, in words."""
    for option in value.get("anyOf", value.get("oneOf", ())):
        yield from _kinds(option)
    if "$ref" in value:
        yield str(value["$ref"]).rpartition("/")[2]
    elif "const" in value:
        yield f"`{value['const']}`"
    elif "enum" in value:
        yield from (f"`{each}`" for each in value["enum"])
    elif "type" in value:
        kinds = value["type"] if isinstance(value["type"], list) else [value["type"]]
        # The text beside another kind is a placeholder of `repeat`.
        yield "list" if kinds[0] == "array" else kinds[0]
