"""The folder that a run leaves.

    DIR/<sensor>/000000.<format>   the frames, in formats of single frames
    DIR/<sensor>/preview.png       a picture of the sensor's last frame
    DIR/cameras/000000.exr         exr_multipart: all cameras at one time
    DIR/frames.zarr, DIR/rosbag2_mcap, DIR/rosbag2_sqlite3     formats of whole runs
    DIR/frames.npz                 the index
    DIR/ids.json                   what ids and classes stand for, see IdTable

Files get their names when they are complete; what holds a whole run is in DIR/unfinished until then.
"""

import re
import shutil
from collections.abc import Iterable
from pathlib import Path

from rigcast.recording.formats import FORMATS
from rigcast.sensors.errors import InputError

INDEX_NAME = "frames.npz"
JOURNAL_NAME = "frames.jsonl"
IDS_NAME = "ids.json"
PREVIEW_NAME = "preview.png"
CAMERAS_NAME = "cameras"
UNFINISHED_NAME = "unfinished"

_RUN_NAMES = tuple(form.suffixes[0] for form in FORMATS.values() if form.holds == "run")


def refuse_names(sensors: Iterable[str]) -> None:
    """Raise InputError for a sensor with the name of another part of the folder."""
    for name in sensors:
        if name in (CAMERAS_NAME, UNFINISHED_NAME, *_RUN_NAMES):
            raise InputError(f"sensor {name!r}: the name of another part of the output folder, expected another name")


def clear_earlier_run(folder: Path, sensors: Iterable[str]) -> None:
    """Remove files of an earlier run whose names a run with these sensors uses."""
    (folder / INDEX_NAME).unlink(missing_ok=True)
    for name in (UNFINISHED_NAME, *_RUN_NAMES):
        if (folder / name).is_dir():
            shutil.rmtree(folder / name)
    suffixes = {suffix for form in FORMATS.values() if form.holds != "run" for suffix in form.suffixes}
    frame_file = re.compile(rf"\d{{6,}}({'|'.join(map(re.escape, sorted(suffixes)))})")
    for below in (folder / CAMERAS_NAME, *(folder / name for name in sensors)):
        for path in below.iterdir() if below.is_dir() else ():
            if path.name == PREVIEW_NAME or frame_file.fullmatch(path.name):
                path.unlink()
