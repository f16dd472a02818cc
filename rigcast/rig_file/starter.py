"""A first rig for a model: sensors on its cameras and on sites and bodies named like sensors, with comments."""

import re
from collections.abc import Iterator
from pathlib import Path

import mujoco

from rigcast.sensors.names import model_names, usable_name
from rigcast.sensors.specs.mount import Parent
from rigcast.sensors.specs.presets import load_preset, preset_names

from .faults import sensor_of_preset

_SCANNING = re.compile(r"lidar|laser|scan|velodyne|ouster|livox|hesai", re.IGNORECASE)
_LOOKING = re.compile(r"depth|camera|realsense|kinect|(?<![a-z])zed", re.IGNORECASE)
_LIDAR = "velodyne_vlp16"  # where a name says no more than that there is a lidar
_LISTED = 20  # names that a comment lists before it is cut short


def starter_rig(model: mujoco.MjModel, model_path: str, schema: str) -> str:
    """The text of a rig file: a depth camera on every camera, a sensor on every site and body named like one.

    Without any lidar of these there is one on top of the first body that moves, or in the world. model_path: what the
    file shall say; schema: path or address of the JSON schema, for editors.
    """
    return "\n".join([*_head(model, model_path, schema), "sensors:", *_sensors(model)]) + "\n"


def _head(model: mujoco.MjModel, model_path: str, schema: str) -> Iterator[str]:
    yield f"# yaml-language-server: $schema={schema}"
    yield f"# The sensors on {Path(model_path).name}. `rigcast validate` checks this file, `rigcast run` runs it."
    yield "# Lengths are in metres and times in seconds; a key in another unit has it in its name (_deg, _hz)."
    yield ""
    yield f"model: {_quoted(model_path)}    # relative to this file"
    keyframes = model_names(model, mujoco.mjtObj.mjOBJ_KEY, model.nkey)
    if keyframes:
        yield f"keyframe: {_quoted(keyframes[0])}    # the state to start from{_others(keyframes)}"
    yield "seed: 0    # the same seed gives the same frames"
    yield ""


def _sensors(model: mujoco.MjModel) -> Iterator[str]:
    cameras = model_names(model, mujoco.mjtObj.mjOBJ_CAMERA, model.ncam)
    sites = model_names(model, mujoco.mjtObj.mjOBJ_SITE, model.nsite)
    bodies = _device_bodies(model)
    places: list[tuple[Parent, str]] = [("site", site) for site in sites] + [("body", body) for body in bodies]
    looking, scanning = ([place for place in places if _kind(place[1]) == kind] for kind in ("depth_camera", "lidar"))
    taken: set[str] = set()
    for camera in cameras:
        yield from _camera(model, camera, usable_name(camera, taken))
    for parent, place in looking:
        device = _device(place) or "realsense_d435"
        yield from _mounted_camera(parent, place, usable_name(place, taken), device)
    for parent, place in scanning:
        mount, device = f"{{{parent}: {_quoted(place)}}}", _device(place) or _LIDAR
        body = _site_body(model, place) if parent == "site" else model.body(place).id
        yield from _lidar(model, usable_name(place, taken), mount, body, device)
    if not scanning:
        yield from _lidar_on_body(model, sites, usable_name("lidar", taken))


def _kind(name: str) -> str | None:
    """The type of sensor that a site or body of this name is for; None for others."""
    device = _device(name)
    if device is not None:
        return load_preset(device).type
    if _SCANNING.search(name):
        return "lidar"
    return "depth_camera" if _LOOKING.search(name) else None


def _device_bodies(model: mujoco.MjModel) -> list[str]:
    """The bodies named like sensors, but of a tree of them, as of a camera's link and its frames, only the topmost, and
    none that has a camera or a site for a sensor."""
    has_place = set(model.cam_bodyid.tolist())
    has_place |= {int(model.site_bodyid[k]) for k in range(model.nsite) if _kind(model.site(k).name)}
    named = {body for body in range(1, model.nbody) if _kind(model.body(body).name)}
    topmost = [body for body in sorted(named) if not named.intersection(_above(model, body))]
    return [model.body(body).name for body in topmost if not any(body in (k, *_above(model, k)) for k in has_place)]


def _above(model: mujoco.MjModel, body: int) -> Iterator[int]:
    """The bodies that a body is on, without the world."""
    while body := int(model.body_parentid[body]):
        yield body


def _device(place: str) -> str | None:
    """The preset that a site's or body's name has most words of, among them the model's, as `front_d455` has."""
    said = set(re.split(r"[\W_]+", place.lower()))
    words = {name: name.split("_") for name in preset_names()}
    meant = [name for name, (first, *more) in words.items() if _means(said, first, more)]
    return max(meant, key=lambda name: len(said.intersection(words[name])), default=None)


def _means(said: set[str], first: str, more: list[str]) -> bool:
    """Whether the words of a name are those of a device: its maker and model, or a model of some length."""
    device = more[0] if more else first
    return device in said and (len(device) > 2 or first in said)


def _camera(model: mujoco.MjModel, camera: str, name: str) -> Iterator[str]:
    index = model.camera(camera).id
    yield f"  - name: {_quoted(name)}"
    yield "    type: depth_camera"
    yield f"    mount: {{camera: {_quoted(camera)}}}    # looks where that camera looks"
    if model.cam_resolution[index].min() <= 1:
        yield "    resolution: [640, 480]    # width, height; the model's camera has no resolution"
    if model.cam_projection[index] == mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC:
        yield "    fov_y_deg: 58    # the model's camera is orthographic"
    yield "    rate_hz: 30"
    yield ""


def _mounted_camera(parent: Parent, place: str, name: str, device: str) -> Iterator[str]:
    yield f"  - name: {_quoted(name)}"
    yield "    type: depth_camera"
    yield f"    preset: {device}    # any key beside it overrides the preset; `rigcast presets` lists them"
    yield f"    mount: {{{parent}: {_quoted(place)}}}    # looks along the {parent}'s +x, with +z up"
    yield f"    rate_hz: {_rate_hz(device, 30):g}"
    if parent == "body":
        yield f"    filter: {{exclude_bodies: [{_quoted(place)}], exclude_subtree: true}}    # its own housing"
    yield ""


def _lidar_on_body(model: mujoco.MjModel, sites: list[str], name: str) -> Iterator[str]:
    if sites:
        yield f"  # Sites that a sensor can be mounted on: {_listed(sites)}."
    moving = [i for i in range(1, model.nbody) if model.body_weldid[i] != 0 and model.body(i).name]
    if not moving:
        yield from _lidar(model, name, "{pos: [0, 0, 1]}    # fixed to the world; or body:, site:, camera:", None)
        return
    body = model.body(moving[0]).name
    mount = f"{{body: {_quoted(body)}, pos: [0, 0, 0.3]}}    # where on the body; or site:, camera:"
    yield from _lidar(model, name, mount, moving[0])


def _lidar(model: mujoco.MjModel, name: str, mount: str, body: int | None, device: str = _LIDAR) -> Iterator[str]:
    root = None if body is None else model.body(model.body_rootid[body]).name
    yield f"  - name: {_quoted(name)}"
    yield "    type: lidar"
    yield f"    preset: {device}    # any key beside it overrides the preset; `rigcast presets` lists them"
    yield f"    mount: {mount}"
    yield f"    rate_hz: {_rate_hz(device, 10):g}"
    if root and root != "world":
        own = f"{{exclude_bodies: [{_quoted(root)}], exclude_subtree: true}}"
        yield f"    filter: {own}    # the robot does not see itself"
    yield ""


def _rate_hz(device: str, usual: float) -> float:
    """The rate of a preset [Hz], or the usual one if its device has several."""
    return sensor_of_preset(device).rate_hz or usual


def _site_body(model: mujoco.MjModel, site: str) -> int:
    return int(model.site_bodyid[model.site(site).id])


def _others(names: list[str]) -> str:
    return f"; others are {_listed(names[1:])}" if len(names) > 1 else ""


def _listed(names: list[str]) -> str:
    return ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")


def _quoted(text: str) -> str:
    """Text as a YAML value, quoted only if needed."""
    plain = re.fullmatch(r"[A-Za-z_/.][\w/. -]*", text) and not text.endswith(" ")
    spoken_for = text.lower() in ("null", "true", "false", "yes", "no", "on", "off") or text.strip(".") == ""
    return text if plain and not spoken_for else "'" + text.replace("'", "''") + "'"
