"""Writers of single frames, by format."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rigcast.export.frames.bins import write_kitti, write_kitti_labels, write_nuscenes, write_nuscenes_labels
from rigcast.export.frames.exr import write_exr
from rigcast.export.frames.las import write_las
from rigcast.export.frames.npz import write_npz
from rigcast.export.frames.pcd import write_pcd
from rigcast.export.frames.ply import write_ply
from rigcast.export.frames.png import write_png
from rigcast.export.ids import IdTable
from rigcast.export.options import Export

FileWriter = Callable[[Path, Any], None]


def file_writers(ids: IdTable, options: Export) -> Mapping[str, tuple[FileWriter, ...]]:
    """For each format of single frames, the writers of its files, in the order of `Format.suffixes`."""
    return {
        "exr": (lambda path, frame: write_exr(path, frame, ids, options.exr_compression),),
        "png": (write_png,),
        "ply": (write_ply,),
        "pcd": (write_pcd,),
        "las": (lambda path, frame: write_las(path, frame, ids, compress=False),),
        "laz": (lambda path, frame: write_las(path, frame, ids, compress=True),),
        "kitti": (write_kitti, lambda path, frame: write_kitti_labels(path, frame, ids)),
        "nuscenes": (write_nuscenes, lambda path, frame: write_nuscenes_labels(path, frame, ids)),
        "npz": (write_npz,),
    }
