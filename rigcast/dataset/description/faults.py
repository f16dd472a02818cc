"""Faults of a data set's file that depend on other files: names, the rig, and other files that it names."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import mujoco

from rigcast.export.fields import field_names
from rigcast.motion.functions import find_function
from rigcast.motion.recorded import read_motion
from rigcast.rig_file import RigConfig, compile_model, read_rig
from rigcast.sensors.errors import InputError
from rigcast.sensors.extras import load_extra
from rigcast.sensors.faults import Fault
from rigcast.sensors.names import expected_one_of, model_names

from .file import DatasetFile, RecordedMotion, UserController

_KINDS = {"body": mujoco.mjtObj.mjOBJ_BODY, "site": mujoco.mjtObj.mjOBJ_SITE, "camera": mujoco.mjtObj.mjOBJ_CAMERA}
_TAKEN = ("failed", "unfinished")  # folders of a data set besides those of scenes


def faults_in(file: DatasetFile, folder: Path) -> list[Fault]:
    """All faults. folder: the file's paths are relative to it. Raises InputError for faults in the rig's own file."""
    rig = read_rig(folder / file.rig) if (folder / file.rig).is_file() else None
    of_inputs = [*_name_faults(file), *_rig_faults(file, folder, rig), *_scene_faults(file, folder)]
    of_inputs += _name_faults_in_scenes(file, folder, rig)
    return [*of_inputs, *_controller_faults(file, folder), *_output_faults(file), *_field_faults(file, rig)]


def _name_faults(file: DatasetFile) -> list[Fault]:
    counts = Counter(scene.name for scene in file.scenes)
    return [
        Fault(("scenes", i, "name"), f"{scene.name!r} is the name of something else too, expected another name")
        for i, scene in enumerate(file.scenes)
        if counts[scene.name] > 1 or scene.name in _TAKEN
    ]


def _rig_faults(file: DatasetFile, folder: Path, rig: RigConfig | None) -> list[Fault]:
    """Faults of a rig that does not exist, or is faulty when it is randomised."""
    if rig is None:
        return [Fault(("rig",), f"{folder / file.rig} is not a file")]
    faults = []
    for end, words in enumerate(("lowest", "highest")):
        try:
            read_rig(folder / file.rig, [f"{key}={ends[end]!r}" for key, ends in file.randomise.rig.items()])
        except InputError as error:
            faults.append(Fault(("randomise", "rig"), f"with the {words} values: {error}"))
    return faults


def _scene_faults(file: DatasetFile, folder: Path) -> list[Fault]:
    faults = []
    for i, scene in enumerate(file.scenes):
        if scene.file is not None and not (folder / scene.file).is_file():
            faults.append(Fault(("scenes", i, "file"), f"{folder / scene.file} is not a file"))
        if scene.python is not None:
            faults += _function_faults(("scenes", i, "python"), folder, scene.python)
    return faults


def _name_faults_in_scenes(file: DatasetFile, folder: Path, rig: RigConfig | None) -> list[Fault]:
    """Names that are missing in the files of scenes; scenes made by functions are checked in their episodes."""
    faults = []
    for i, scene in enumerate(file.scenes):
        names = None if scene.file is None else _names_in(folder / scene.file)
        if names is not None:
            faults += _pose_faults(file, scene.name, names["body"][1:])
            faults += [] if rig is None else _rig_faults_in_scene(rig, i, names)
    return faults


def _pose_faults(file: DatasetFile, scene: str, bodies: list[str]) -> list[Fault]:
    """Faults for bodies to be moved that cannot be moved."""
    return [
        Fault(
            ("randomise", "poses", name),
            f"no body {name!r} that can be moved in the scene {scene!r}, {expected_one_of(name, bodies)}",
            at_key=True,
        )
        for name in file.randomise.poses
        if name not in bodies
    ]


def _rig_faults_in_scene(rig: RigConfig, i: int, names: Mapping[str, list[str]]) -> list[Fault]:
    """Carriers of sensors and props, and bodies in filters, that the i-th scene does not have."""
    mounts = [(each.name, each.mount) for each in (*rig.sensors, *rig.props)]
    wanted = [
        (mount.parent, getattr(mount, mount.parent), f"on which {name!r} of the rig is mounted")
        for name, mount in mounts
        if mount.parent != "world"
    ]
    wanted += [
        ("body", body, f"which the filter of {sensor.name!r} in the rig excludes")
        for sensor in rig.sensors
        for body in sensor.filter.exclude_bodies
    ]
    return [
        Fault(("scenes", i, "file"), f"no {kind} {name!r} there, {what}; {expected_one_of(name, names[kind])}")
        for kind, name, what in dict.fromkeys(wanted)
        if name not in names[kind]
    ]


def _names_in(path: Path) -> dict[str, list[str]] | None:
    """Names by kind, read without meshes, which take long; None if it cannot be read, as its episodes report."""
    try:
        if path.suffix == ".mjb":
            model = compile_model(path)
            counts = {"body": model.nbody, "site": model.nsite, "camera": model.ncam}
            return {kind: model_names(model, _KINDS[kind], count) for kind, count in counts.items()}
        spec = mujoco.MjSpec.from_file(str(path))
        elements = {"body": spec.bodies, "site": spec.sites, "camera": spec.cameras}
        return {kind: [each.name for each in found if each.name] for kind, found in elements.items()}
    except (InputError, ValueError, mujoco.FatalError):
        return None


def _controller_faults(file: DatasetFile, folder: Path) -> list[Fault]:
    controller, where = file.episodes.controller, ("episodes", "controller")
    if isinstance(controller, UserController):
        return _function_faults((*where, "function"), folder, controller.function)
    if not isinstance(controller, RecordedMotion):
        return []
    try:
        rows = read_motion(folder / controller.file)
    except InputError as error:
        return [Fault((*where, "file"), str(error))]
    lasts = (len(rows) - 1) / controller.rate_hz
    if lasts < file.episodes.duration - 1e-9:
        return [Fault(("episodes", "duration"), f"got {file.episodes.duration:g} s, but the motion lasts {lasts:g} s")]
    return []


def _output_faults(file: DatasetFile) -> list[Fault]:
    if file.output.format != "zarr":
        return []
    try:
        load_extra("the format zarr", "zarr", "zarr")
    except InputError as error:
        return [Fault(("output", "format"), str(error))]
    return []


def _field_faults(file: DatasetFile, rig: RigConfig | None) -> list[Fault]:
    if rig is None:
        return []  # reported as a fault of its own
    kinds = {spec.name: spec.type for spec in rig.sensors}
    faults = []
    for sensor, chosen in file.output.fields.items():
        where = ("output", "fields", sensor)
        if sensor not in kinds:
            faults.append(Fault(where, f"no sensor {sensor!r}, {expected_one_of(sensor, list(kinds))}", at_key=True))
            continue
        known = field_names(kinds[sensor])
        faults += [
            Fault((*where, i), f"no field {name!r} of a {kinds[sensor]}, {expected_one_of(name, known)}")
            for i, name in enumerate(chosen)
            if name not in known
        ]
    return faults


def _function_faults(where: tuple[str | int, ...], folder: Path, name: str) -> list[Fault]:
    try:
        find_function(folder, name)
    except InputError as error:
        return [Fault(where, str(error))]
    return []
