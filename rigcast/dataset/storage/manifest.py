"""dataset.json: the contents of a data set, its provenance, and what is missing.

`config`, `scenes`, `sources` (SHA-256 of the files that it follows from) and `made_with` (versions, device, compiler
flags) are the data set's; `shards` has the entry of every finished episode: `scene`, `episode`, `seed`,
`scene_sha256` of the compiled model, the values drawn for `rig` and `poses`, for each of `sensors` its frames' times
and statistics, and `files` with sizes and checksums. `failed` has the other episodes that were tried, with reasons;
`missing` is how many have neither. `statistics` by sensor: frames, rays, hits and [least, mean, most] range [m].

The manifest is derived from the folder's contents, so any of the jobs that share it can write it again at any time.
"""

import json
import shutil
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from rigcast.dataset.description.config import DatasetConfig, Unit
from rigcast.export.files import make_writable, replacing
from rigcast.sensors.errors import InputError

from .shards import ENTRY_NAME
from .statistics import combined
from .stores import FolderStore, Store

MANIFEST_NAME = "dataset.json"
FORMAT = "rigcast dataset 1"
_FAILED_NAME = "failed"
_ABANDONED = 3600.0  # seconds after which a half-written manifest is taken to be from a killed job


def begin(config: DatasetConfig, folder: Path, made_with: dict[str, str]) -> None:
    """Prepare the folder, or check that its contents belong to the same data set.

    A data set of which every episode failed may be replaced by another, because it left nothing.

    Raises InputError for a folder that cannot be written, or that holds another data set.
    """
    make_writable(folder)
    for part in folder.glob(f".{MANIFEST_NAME}.*.part"):
        with suppress(OSError):  # other jobs sweep, too
            if time.time() - part.stat().st_mtime > _ABANDONED:
                part.unlink()
    path = folder / MANIFEST_NAME
    known = read_manifest(FolderStore(folder)) if path.is_file() else None
    if known is not None and (known["shards"] or known["missing"]):
        _require_same(path, known, {**config.identity(), "made_with": made_with})
        return
    if known is not None:
        shutil.rmtree(folder / _FAILED_NAME, ignore_errors=True)
    write_manifest(config, folder, made_with)


def is_finished(folder: Path, unit: Unit) -> bool:
    """Whether the shard of an episode exists."""
    return (folder / unit.name / ENTRY_NAME).is_file()


def note_failure(folder: Path, unit: Unit, reason: str | None) -> None:
    """Record the reason why an episode has no shard; None if it has one."""
    path = _failure(folder, unit)
    if reason is None:
        path.unlink(missing_ok=True)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_text(json.dumps({**unit._asdict(), "reason": reason}))


def write_manifest(config: DatasetConfig, folder: Path, made_with: dict[str, str]) -> dict[str, Any]:
    """Write dataset.json for what is in the folder now, and return it."""
    while True:
        manifest = _collected(config, folder, made_with)
        with replacing(folder / MANIFEST_NAME, f".{uuid.uuid4().hex}") as temporary:
            temporary.write_text(json.dumps(manifest))
        # Another job may have made the last shard, and written its manifest, since this one looked. While shards are
        # missing, whoever makes them writes the manifest after that.
        if not manifest["missing"] or not _is_complete(config, folder):
            _remove_if_empty(folder / _FAILED_NAME)
            return manifest


def read_manifest(store: Store) -> dict[str, Any]:
    """The manifest of a data set. Raises InputError if there is none."""
    where = store.where(MANIFEST_NAME)
    try:
        with store.open(MANIFEST_NAME) as file:
            manifest = json.loads(file.read())
    except (OSError, ValueError) as error:
        reason = (isinstance(error, OSError) and error.strerror) or error
        raise InputError(f"{where}: not the manifest of a data set: {reason}") from None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise InputError(f"{where}: not the manifest of a data set: expected format {FORMAT!r}")
    return manifest


def shard_name(entry: Mapping[str, Any]) -> str:
    """The folder of an entry's shard, within that of the data set."""
    return Unit(entry["scene"], entry["episode"], entry["seed"]).name


def _is_complete(config: DatasetConfig, folder: Path) -> bool:
    """Whether every episode has a shard or a recorded failure."""
    return all(is_finished(folder, unit) or _failure(folder, unit).is_file() for unit in config.units())


def _failure(folder: Path, unit: Unit) -> Path:
    return folder / _FAILED_NAME / f"{unit.name}.json"


def _collected(config: DatasetConfig, folder: Path, made_with: dict[str, str]) -> dict[str, Any]:
    units = config.units()
    shards = list(_entries(folder / unit.name / ENTRY_NAME for unit in units))
    failed = list(_entries(_failure(folder, unit) for unit in units if not is_finished(folder, unit)))
    return {
        "format": FORMAT,
        **config.identity(),
        "made_with": made_with,
        "statistics": combined(shards),
        "previews": [f"{shard_name(entry)}/{name}" for entry in shards for name in entry["files"] if _is_preview(name)],
        "missing": len(units) - len(shards) - len(failed),
        "failed": failed,
        "shards": shards,
    }


def _entries(paths: Iterator[Path]) -> Iterator[dict[str, Any]]:
    for path in paths:
        if path.is_file():
            try:
                yield json.loads(path.read_text(encoding="utf-8"))
            except ValueError as error:
                mended = f"remove {path.parent}, and the same command makes it again"
                raise InputError(f"{path}: not as it was written: {error}; {mended}") from None


def _is_preview(name: str) -> bool:
    return name.endswith(".png") and "/" not in name


def _require_same(path: Path, stored: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Raise InputError if anything that existing frames depend on has changed; new scenes and episodes are allowed."""
    differences = [
        f"{part}.{key}: got {given[part][key]!r:.200}, there it was {was!r:.200}"
        for part in ("config", "scenes", "sources", "made_with")
        for key, was in stored[part].items()
        if key in given[part] and given[part][key] != was
    ]
    if differences:
        lines = "\n".join(f"  {line}" for line in differences)
        raise InputError(f"{path.parent} holds another data set, expected an empty folder or the same one:\n{lines}")


def _remove_if_empty(folder: Path) -> None:
    if folder.is_dir() and not any(path.is_file() for path in folder.rglob("*")):
        shutil.rmtree(folder, ignore_errors=True)
