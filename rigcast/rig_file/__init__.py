"""Rig files: from YAML to a rig on a MuJoCo model, with every mistake shown where it is in the file."""

from .config import RigConfig, compile_model, load_rig, open_rig, read_rig
from .faults import sensor_of_preset

__all__ = ["RigConfig", "compile_model", "load_rig", "open_rig", "read_rig", "sensor_of_preset"]
