"""Rig files with faults in them, as hypothesis strategies."""

import json
from collections.abc import Sequence
from typing import Any

from hypothesis import strategies as st

TOKENS = (
    *("[", "]", "{", "}", ":", ",", "- ", "&a ", "*a", "!!python/object ", "!x ", "<<: ", "? ", "|\n", ">\n", "---\n"),
    *("...\n", "%YAML 9.9\n", "#", "\n", "\t", "  ", "'", '"', "\\", "\x00", "\ufeff", "\u2028", "é", "null", "~"),
    *("true", ".nan", ".inf", "-.inf", "1e999", "-1", "0x1F", "0o7", "1_000", "9" * 400, "2001-01-01", "name", "type"),
)
PIECES = st.sampled_from(TOKENS).map(lambda token: token.encode()) | st.binary(max_size=4)
EDITS = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 12), PIECES), min_size=1, max_size=6)

NUMBERS = st.integers() | st.floats() | st.sampled_from([0, -1, 10**30, 1e308, 2**63])
VALUES: st.SearchStrategy[Any] = st.recursive(
    NUMBERS | st.none() | st.booleans() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
KEYS = (
    *("mount", "filter", "preset", "rate_hz", "min_range", "max_range", "elevation_deg", "azimuth_deg", "columns"),
    *("resolution", "fov_y_deg", "size", "spacing", "alignment", "phase", "latency", "jitter", "frame_loss"),
    *("column_period_us", "firing_time_us", "scan_time", "origin_height", "rosette", "nodding", "rays", "ray_file"),
)
INNER = st.dictionaries(
    st.sampled_from(("body", "site", "camera", "pos", "quat", "euler_deg", "geom_groups", "exclude_bodies", "static")),
    VALUES,
    max_size=4,
)
SENSORS = st.builds(
    lambda kind, keys: {"name": "a", "mount": {}, "type": kind, **keys},
    st.sampled_from(("lidar", "depth_camera", "height_scan")) | VALUES,
    st.dictionaries(st.sampled_from(KEYS), VALUES | INNER, max_size=6),
)


def mutated(originals: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """One of the texts with some of its bytes replaced."""
    return st.builds(_edit, st.sampled_from(originals), EDITS)


def _edit(text: bytes, edits: list[tuple[float, int, bytes]]) -> bytes:
    for where, length, piece in edits:
        start = int(where * len(text))
        text = text[:start] + piece + text[start + length :]
    return text


def as_yaml(content: Any) -> bytes:
    """The content as YAML in flow style: JSON, with YAML's forms of infinity and NaN."""
    text = json.dumps(content).replace("-Infinity", "-.inf").replace("Infinity", ".inf").replace("NaN", ".nan")
    return text.encode()
