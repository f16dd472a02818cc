"""Readings in rerun: clouds in as many colours as they have values, depth images, sensors and bodies over time."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.extras import load_extra
from rigcast.sensors.meshes import mesh_of_model
from rigcast.sensors.preview.colour import Scale, id_colours
from rigcast.view.shots import VALUES, Shot, sensors_in, values_in

if TYPE_CHECKING:
    import rerun

TIMELINE = "simulation"
_GEOM = mujoco.mjtGeom
_THICKNESS = 0.001  # m, of the box that stands for a plane
_WIDEST = 20.0  # m, half the side of an infinite plane


class Moment(NamedTuple):
    """Poses of a model's bodies at a moment: time [s], xpos (nbody, 3) [m] and xquat (nbody, 4), w first."""

    time: float
    xpos: NDArray[np.float64]
    xquat: NDArray[np.float64]


def load_rerun() -> ModuleType:
    """Import rerun. Raises InputError if it is not installed."""
    return load_extra("Looking at sensors in rerun", "rerun", "view")


def show_in_rerun(
    title: str, shots: Sequence[Shot], save: Path | None, model: mujoco.MjModel | None, moments: Sequence[Moment]
) -> None:
    """Show the shots in rerun's viewer, or write them to `save`, a recording (.rrd).

    model, moments: what the world looks like, and where its bodies are when; None where that is not known. Height
    fields, flexes and skins are not drawn.

    Raises InputError where rerun is not installed.
    """
    rr = load_rerun()
    recording = rr.RecordingStream(title)
    blueprint = _blueprint(shots)
    if save is None:
        recording.spawn(default_blueprint=blueprint)
    else:
        recording.save(save, default_blueprint=blueprint)
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    if model is not None:
        _log_model(recording, model)
        for moment in moments:
            _log_bodies(recording, model, moment)
    scales = {name: _scale(name, shots) for name in VALUES}
    for shot in shots:
        _log_shot(recording, shot, scales)
    recording.flush()
    recording.disconnect()


def _blueprint(shots: Sequence[Shot]) -> Any:
    """A view of the clouds for each value that they can be coloured by, and the images beside them."""
    import rerun.blueprint as rrb

    names, sensors = values_in(shots), sensors_in(shots)
    images = sensors_in(filter(_has_depth, shots))

    def view(chosen: str) -> Any:
        others = [f"- /sensors/{sensor}/by_{n}/**" for sensor in sensors for n in names if n != chosen]
        return rrb.Spatial3DView(origin="/", name=f"by {chosen}", contents=["+ /**", *others])

    pictures = [rrb.Spatial2DView(origin=f"/sensors/{name}/camera", name=name) for name in images]
    clouds = rrb.Tabs(*map(view, names))
    return rrb.Blueprint(rrb.Horizontal(clouds, rrb.Vertical(*pictures), column_shares=[3, 1]) if pictures else clouds)


def _scale(name: str, shots: Sequence[Shot]) -> Scale:
    values = [np.asarray(shot.values[name], float) for shot in shots if name in shot.values]
    return Scale.of(np.concatenate([np.empty(0), *values]), reverse=name == "range")


def _log_shot(recording: "rerun.RecordingStream", shot: Shot, scales: dict[str, Scale]) -> None:
    import rerun as rr

    path = f"sensors/{shot.sensor}"
    recording.set_time(TIMELINE, duration=shot.time)
    recording.log(path, rr.Transform3D(translation=shot.pose[:3, 3], mat3x3=shot.pose[:3, :3]))
    values_of_points = {} if _has_depth(shot) else shot.values  # a depth image stands in space by itself
    for name, values in values_of_points.items():
        colours = id_colours(values) if name == "geom_id" else scales[name].colours(np.asarray(values, float))
        recording.log(f"{path}/by_{name}", rr.Points3D(shot.points, colors=colours, radii=rr.Radius.ui_points(1.5)))
    if shot.image is not None and shot.intrinsics is not None:
        height, width = shot.image.shape
        pinhole = rr.Pinhole(image_from_camera=shot.intrinsics, width=width, height=height)
        recording.log(f"{path}/camera", pinhole)
        depth = np.where(np.isfinite(shot.image), shot.image, 0.0)  # rerun's sign for "no depth"
        recording.log(f"{path}/camera", rr.DepthImage(depth.astype(np.float32), meter=1.0))


def _has_depth(shot: Shot) -> bool:
    """Whether a shot has an image of z-depths, and not of ranges, which a pinhole cannot show."""
    return shot.intrinsics is not None


def _log_bodies(recording: "rerun.RecordingStream", model: mujoco.MjModel, moment: Moment) -> None:
    import rerun as rr

    recording.set_time(TIMELINE, duration=moment.time)
    for body in range(model.nbody):
        w, x, y, z = moment.xquat[body]
        pose = rr.Transform3D(translation=moment.xpos[body], quaternion=rr.Quaternion(xyzw=[x, y, z, w]))
        recording.log(f"bodies/{_body_name(model, body)}", pose)


def _log_model(recording: "rerun.RecordingStream", model: mujoco.MjModel) -> None:
    for geom in range(model.ngeom):
        name = model.geom(geom).name or f"geom_{geom}"
        for shape in _shape(model, geom):
            recording.log(f"bodies/{_body_name(model, int(model.geom_bodyid[geom]))}/{name}", shape, static=True)


def _body_name(model: mujoco.MjModel, body: int) -> str:
    return model.body(body).name or f"body_{body}"


def _shape(model: mujoco.MjModel, geom: int) -> Iterator[Any]:
    """A geom for rerun, with its pose on its body; nothing for transparent geoms and height fields."""
    import rerun as rr

    rgba = model.geom_rgba[geom] if model.geom_matid[geom] < 0 else model.mat_rgba[model.geom_matid[geom]]
    if rgba[3] == 0:
        return
    w, x, y, z = model.geom_quat[geom]
    yield rr.InstancePoses3D(translations=[model.geom_pos[geom]], quaternions=[rr.Quaternion(xyzw=[x, y, z, w])])
    size, look = model.geom_size[geom], {"colors": [rgba], "fill_mode": "solid"}
    match model.geom_type[geom]:
        case _GEOM.mjGEOM_PLANE:
            half = [side or _WIDEST for side in size[:2]]
            yield rr.Boxes3D(half_sizes=[[*half, _THICKNESS]], centers=[[0, 0, -_THICKNESS]], **look)
        case _GEOM.mjGEOM_BOX:
            yield rr.Boxes3D(half_sizes=[size], **look)
        case _GEOM.mjGEOM_SPHERE:
            yield rr.Ellipsoids3D(half_sizes=[[size[0]] * 3], **look)
        case _GEOM.mjGEOM_ELLIPSOID:
            yield rr.Ellipsoids3D(half_sizes=[size], **look)
        case _GEOM.mjGEOM_CYLINDER:
            yield rr.Cylinders3D(lengths=[2 * size[1]], radii=[size[0]], **look)
        case _GEOM.mjGEOM_CAPSULE:  # rerun's begins at its origin
            yield rr.Capsules3D(lengths=[2 * size[1]], radii=[size[0]], translations=[[0, 0, -size[1]]], **look)
        case _GEOM.mjGEOM_MESH | _GEOM.mjGEOM_SDF:
            vertices, faces = mesh_of_model(model, model.geom_dataid[geom])
            yield rr.Mesh3D(vertex_positions=vertices, triangle_indices=faces, albedo_factor=rgba)
