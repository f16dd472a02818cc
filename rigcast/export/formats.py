"""Which sensor is written in which format."""

from collections.abc import Sequence

from rigcast.sensors.errors import InputError
from rigcast.sensors.names import did_you_mean
from rigcast.sensors.specs.depth_camera import DepthCamera
from rigcast.sensors.specs.sensor_spec import SensorSpec

FORMATS = ("exr", "ply", "npz")


def choose_formats(sensors: Sequence[SensorSpec], formats: Sequence[str] | None) -> dict[str, tuple[str, ...]]:
    """Give every sensor, by name, the formats that fit it: all fit a depth camera, all but exr the others.

    Args:
        sensors: of one rig.
        formats: any of FORMATS; None is exr for depth cameras and ply for the others.

    Raises:
        InputError: no format, unknown formats, or sensors that none of them fits; all that are, at once.
    """
    if formats is None:
        return {spec.name: ("exr",) if _is_image(spec) else ("ply",) for spec in sensors}
    wanted = tuple(dict.fromkeys(formats))
    faults = [_unknown(name) for name in wanted if name not in FORMATS]
    if not wanted:
        faults = [f"--format: got none, expected any of {', '.join(FORMATS)}"]
    if faults:
        raise InputError("\n".join(faults))
    chosen = {spec.name: tuple(f for f in wanted if f != "exr" or _is_image(spec)) for spec in sensors}
    faults = [_unfit(spec) for spec in sensors if not chosen[spec.name]]
    if faults:
        raise InputError("\n".join(faults))
    return chosen


def _is_image(spec: SensorSpec) -> bool:
    return isinstance(spec, DepthCamera)


def _unknown(name: str) -> str:
    return f"--format: got {name!r}, expected any of {', '.join(FORMATS)}{did_you_mean(name, FORMATS)}"


def _unfit(spec: SensorSpec) -> str:
    return (
        f"--format: sensor {spec.name!r} is a {spec.type}, and got exr only, which holds depth cameras; "
        f"expected ply or npz as well"
    )
