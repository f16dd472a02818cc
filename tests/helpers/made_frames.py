"""Frames with chosen readings, and a small model for the ids in them."""

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.sensors.rig.frame import CameraFrame, Frame, LidarFrame, Source
from rigcast.sensors.scene.shape_ids import ShapeIds

MODEL_XML = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="crate" pos="2 0 0.5"><geom type="box" size="0.5 0.5 0.5"/></body>
    <body pos="0 3 1"><geom name="ball" size="0.4"/></body>
  </worldbody>
</mujoco>
"""

# A rotation about a general axis: none of its entries is a float32.
POSE = np.eye(4)
POSE[:3, :3] = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
POSE[:3, 3] = (1e4 + 1 / 3, -np.pi, 0.1)

INTRINSICS = np.array([[525.3, 0.0, 319.7], [0.0, 524.9, 239.1], [0.0, 0.0, 1.0]])


def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL_XML)


def make_frame(kind: type[Frame], distance: NDArray[np.float32], **given: Any) -> Any:
    """A frame of `kind` whose range is `distance`; other fields are random, and misses where that is not finite.

    Fields can be `given` by name, and a `pattern`, which all but cameras need for a picture. The fields, which a frame
    computes on request, are already computed.
    """
    own = _own_fields(kind) | ({"lens": given.pop("lens")} if "lens" in given else {})
    sensor, time, pattern = given.pop("sensor", "eye"), given.pop("time", 0.1), given.pop("pattern", None)
    fields = _random_fields(kind, distance) | {"range": distance} | given
    arrays = {name: wp.array(array, device="cpu") for name, array in fields.items()}
    hit: Any = SimpleNamespace(range=arrays.pop("range"), normal=arrays.pop("normal"))
    nothing: Any = None
    source = Source(sensor, ShapeIds({}), nothing, firing_times=None, ring=None, column=None, pattern=pattern)
    frame = kind(time=time, pose=POSE, shape=distance.shape, _arrays=hit, _source=source, **own)
    vars(frame).update(arrays)
    if kind is not Frame and "intensity" not in given:
        vars(frame)["intensity"] = None
    return frame


def random_range(shape: tuple[int, ...], seed: int) -> NDArray[np.float32]:
    """Ranges between 0.1 and 50 m, of which about one in eight each is no return, too near and invalid."""
    rng = np.random.default_rng(seed)
    distance = rng.uniform(0.1, 50.0, shape).astype(np.float32)
    for value in (np.inf, -np.inf, np.nan):
        distance[rng.random(shape) < 0.125] = value
    return distance


def _own_fields(kind: type[Frame]) -> dict[str, Any]:
    """Arguments of the constructor of this kind alone."""
    if kind is CameraFrame:
        return {"intrinsics": INTRINSICS, "lens": None, "depth_scale": 0.001, "_intensity": None}
    return {"_intensity": None} if kind is LidarFrame else {}


def _random_fields(kind: type[Frame], distance: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
    rng = np.random.default_rng(distance.size)
    shape, hit = distance.shape, np.isfinite(distance)
    normal = rng.normal(size=(*shape, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return {
        "points": np.where(hit[..., None], rng.normal(size=(*shape, 3)), np.nan).astype(np.float32),
        "normal": np.where(hit[..., None], normal, 0.0).astype(np.float32),
        "geom_id": np.where(hit, rng.integers(0, 3, shape), -1).astype(np.int32),
        "body_id": np.where(hit, rng.integers(0, 3, shape), -1).astype(np.int32),
        "stamp": 1700000000.123 + rng.random(shape),
        **(_of_camera(rng, distance) if kind is CameraFrame else {}),
        **(_of_lidar(shape) if kind is LidarFrame else {}),
    }


def _of_lidar(shape: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    ring, column, *_ = np.indices(shape, dtype=np.int32)
    return {"ring": ring, "column": column}


def _of_camera(rng: np.random.Generator, distance: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
    return {
        "depth": (0.8 * distance).astype(np.float32),
        "depth_16bit": rng.integers(0, 65536, distance.shape, np.uint16),
    }
