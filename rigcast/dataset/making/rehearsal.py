"""A trial before any episode is made, so that a fault common to all of them is reported once."""

from pathlib import Path

from rigcast.dataset.description.config import DatasetConfig
from rigcast.dataset.description.file import SceneSource, UserController
from rigcast.dataset.storage.manifest import is_finished
from rigcast.motion.functions import FunctionFault
from rigcast.sensors.device import compiling, find_device
from rigcast.sensors.errors import InputError

from .environment import prepare_warp
from .episode import open_episode, reason_of

_TRIED = 2  # episodes of a scene: a single one may fail because of its seed


def rehearse(config: DatasetConfig, folder: Path, device: str | None) -> None:
    """Call every function once and cast once, so that workers find the kernels compiled; nothing is written.

    Raises InputError for a function with which the first two episodes of a scene fail, if none of that scene is
    there yet, for a device that does not exist, and for kernels that cannot be written. Any other fault of a
    scene fails its episodes.
    """
    prepare_warp(config.file.portable)
    find_device(device)
    called, has_cast = set[str](), False
    for scene in config.file.scenes:
        functions = _functions(config, scene)
        if has_cast and functions <= called:
            continue
        with compiling():
            errors = _errors(config, scene, device)
        if not errors:
            called, has_cast = called | functions, True
        elif all(_is_of_function(error, scene) for error in errors) and not _has_begun(config, scene, folder):
            raise InputError(f"{config.path}: scene {scene.name!r}: {reason_of(errors[0])}")


def _functions(config: DatasetConfig, scene: SceneSource) -> set[str]:
    controller = config.file.episodes.controller
    names = {controller.function} if isinstance(controller, UserController) else set()
    return names if scene.python is None else {*names, scene.python}


def _is_of_function(error: Exception, scene: SceneSource) -> bool:
    return scene.python is not None or isinstance(error, FunctionFault)


def _has_begun(config: DatasetConfig, scene: SceneSource, folder: Path) -> bool:
    return any(is_finished(folder, config.unit(scene.name, k)) for k in range(config.file.episodes.count))


def _errors(config: DatasetConfig, scene: SceneSource, device: str | None) -> list[Exception]:
    """The errors of a scene's first episodes at their first step; empty if one of them succeeds."""
    errors = list[Exception]()
    for number in range(min(_TRIED, config.file.episodes.count)):
        try:
            episode = open_episode(config, config.unit(scene.name, number), device)
            episode.step()
            episode.rig.sense(episode.data)
        except OSError:  # functions and files have errors of their own
            raise
        except Exception as error:  # reported as for an episode that fails
            errors.append(error)
        else:
            return []
    return errors
