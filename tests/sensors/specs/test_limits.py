"""Limits of the numeric keys, as in the schema; a key that is not listed here takes any finite number."""

from typing import Any

import pytest

from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.cameras.ranging import Ranging, Stereo, TimeOfFlight
from rigcast.sensors.specs.height_scan import HeightScan
from rigcast.sensors.specs.lens import BrownConrady, KannalaBrandt
from rigcast.sensors.specs.lidars.effects import Beam, Detection, Noise, Weather
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.lidars.ray_arrays import RayArrays
from rigcast.sensors.specs.lidars.ray_file import RayFile
from rigcast.sensors.specs.lidars.rosette import Nodding, Rosette, Steered, Wedge
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.sensor_spec import SensorSpec
from rigcast.sensors.specs.spec import Spec
from rigcast.sensors.specs.surface import Surface

FREE: dict[str, Any] = {}
POSITIVE = {"exclusiveMinimum": 0}
NOT_NEGATIVE = {"minimum": 0}
SHARE = {"minimum": 0, "maximum": 1}
ANGLE_OF_VIEW = {"exclusiveMinimum": 0, "exclusiveMaximum": 180}
# the keys that a specification adds to those of its base
LIMITS: list[tuple[type[Spec], dict[str, dict[str, Any]]]] = [
    (
        SensorSpec,
        {
            "rate_hz": POSITIVE,
            "phase": NOT_NEGATIVE,
            "latency": NOT_NEGATIVE,
            "jitter": NOT_NEGATIVE,
            "frame_loss": SHARE,
            "min_range": NOT_NEGATIVE,
            "max_range": POSITIVE,
        },
    ),
    (
        Lidar,
        {
            "columns": {"minimum": 1, "maximum": 100_000},
            "column_period_us": POSITIVE,
            "scan_time": NOT_NEGATIVE,
            "origin_radius": NOT_NEGATIVE,
            "pulse_length": {"exclusiveMinimum": 0, "maximum": 1e-6},
            "max_surfaces": {"minimum": 1, "maximum": 4},
            "mirror_lobe_deg": {"minimum": 0, "maximum": 90},
        },
    ),
    (
        Noise,
        {
            "range_std": NOT_NEGATIVE,
            "range_resolution": NOT_NEGATIVE,
            "angle_std_deg": {"minimum": 0, "maximum": 10},
            "dropout": SHARE,
            "dark_dropout": SHARE,
            "dark_limit": POSITIVE,
        },
    ),
    (
        Detection,
        {
            "range": {"minimum": 1e-3, "maximum": 1e6},
            "reflectivity": {"exclusiveMinimum": 0, "maximum": 1},
            "accuracy": POSITIVE,
            "accuracy_range": POSITIVE,
            "accuracy_reflectivity": {"exclusiveMinimum": 0, "maximum": 1},
        },
    ),
    (Beam, {"rings": {"minimum": 1, "maximum": 6}}),
    (
        Weather,
        {"rain_rate": {"minimum": 0, "maximum": 500}, "rain_range_noise": NOT_NEGATIVE, "visibility": {"minimum": 5}},
    ),
    (RayArrays, {}),
    (RayFile, {"sample_rate_hz": POSITIVE}),
    (Steered, {"sample_rate_hz": POSITIVE, "start": FREE}),
    (Rosette, {}),
    (Nodding, {"spin_rpm": FREE, "nod_hz": FREE}),
    (Wedge, {"rpm": FREE, "tilt_deg": {"exclusiveMinimum": -90, "exclusiveMaximum": 90}, "index": {"minimum": 1}}),
    (
        DepthCamera,
        {
            "fov_x_deg": ANGLE_OF_VIEW,
            "fov_y_deg": ANGLE_OF_VIEW,
            "fx": {"minimum": 1e-6},
            "fy": {"minimum": 1e-6},
            "cx": {"minimum": -1e9, "maximum": 1e9},
            "cy": {"minimum": -1e9, "maximum": 1e9},
            "readout_time": NOT_NEGATIVE,
            "depth_scale": POSITIVE,
        },
    ),
    (
        Ranging,
        {
            "dropout": SHARE,
            "max_incidence_deg": {"exclusiveMinimum": 0, "maximum": 90},
            "min_intensity": NOT_NEGATIVE,
        },
    ),
    (
        Stereo,
        {
            "baseline": FREE,
            "disparity_std": NOT_NEGATIVE,
            "disparity_step": NOT_NEGATIVE,
            "max_disparity": POSITIVE,
            "matching_window": {"minimum": 1},
            "untextured_dropout": SHARE,
        },
    ),
    (
        TimeOfFlight,
        {
            "range_std": NOT_NEGATIVE,
            "bias": FREE,
            "bias_per_metre": {"exclusiveMinimum": -1},
            "modulation_hz": POSITIVE,
            "subrays": {"minimum": 1, "maximum": 8},
        },
    ),
    (BrownConrady, dict.fromkeys(("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), FREE)),
    (KannalaBrandt, dict.fromkeys(("k1", "k2", "k3", "k4"), FREE)),
    (HeightScan, {"spacing": POSITIVE}),
    (Prop, {"scale": FREE}),
    (Surface, {"reflectivity": NOT_NEGATIVE, "transmission": SHARE, "mirror": SHARE}),
]
BOUNDS = ("minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum")


@pytest.mark.parametrize(("spec", "limits"), LIMITS, ids=[spec.__name__ for spec, _ in LIMITS])
def test_a_number_has_the_limits_of_its_key(spec: type[Spec], limits: dict[str, dict[str, Any]]) -> None:
    schema = spec.model_json_schema()["properties"]
    kinds = {key: [schema[key], *schema[key].get("anyOf", ())] for key in schema if key in spec.__annotations__}
    assert limits == {
        key: {bound: kind[bound] for bound in BOUNDS if bound in kind}
        for key, of_key in kinds.items()
        for kind in of_key
        if kind.get("type") in ("number", "integer")
    }
