"""`rigcast publish`: step the simulation in real time and publish its sensors' frames to ROS 2."""

import itertools
from time import perf_counter, sleep
from typing import Annotated

import mujoco
import typer
from rich.console import Console

from rigcast.cli.common.moving import Controller, Motion, MotionRate, moving
from rigcast.cli.common.options import Device, ModelPath, Overrides, RigPath, Seed, counted, say
from rigcast.cli.common.ready import ready_rig
from rigcast.motion.simulation import initial_data, step_count
from rigcast.motion.steps import Step
from rigcast.rig_file import open_rig
from rigcast.ros.node import RosNode, require_ros
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.rig import Rig


def publish(
    rig: RigPath,
    model: ModelPath = None,
    duration: Annotated[
        float | None, typer.Option(help="time to simulate [s]  [default: until Ctrl-C, or the end of the motion]")
    ] = None,
    speed: Annotated[float, typer.Option(help="simulated seconds per second at most")] = 1.0,
    controller: Controller = None,
    motion: Motion = None,
    motion_rate: MotionRate = None,
    device: Device = None,
    seed: Seed = None,
    overrides: Overrides = None,
) -> None:
    """Simulate a rig on its model and publish its frames to ROS 2."""
    if not speed > 0.0:
        raise InputError(f"--speed: got {speed}, expected a positive number")
    require_ros()
    console = Console(highlight=False)
    config, compiled = open_rig(rig, model, overrides or ())
    moved = moving(rig, compiled, controller, motion, motion_rate)
    simulated = moved.duration(duration)
    steps = None if simulated is None else step_count(compiled, simulated)
    data = initial_data(compiled, config.keyframe)
    step = moved.step(compiled, data, config.seed if seed is None else seed)
    loaded = ready_rig(console, config, compiled, data, device, seed)
    node = RosNode(compiled, config.sensors, classes=config.classes, props=config.props, options=config.export)
    with node:
        say(console, f"{rig}: publishing {', '.join(spec.name for spec in config.sensors)}; Ctrl-C ends it")
        frames = _simulate(loaded, data, step, node, steps, speed)
    say(console, f"published {counted(frames, 'frame')}")


def _simulate(rig: Rig, data: mujoco.MjData, step: Step, node: RosNode, steps: int | None, speed: float) -> int:
    """Step and publish at most at `speed` times real time; return the number of frames."""
    count = 0
    began, start = perf_counter(), data.time
    node.step(data, ())
    for _ in itertools.count() if steps is None else range(steps):
        step()
        frames = rig.step(data)
        node.step(data, frames)
        count += len(frames)
        sleep(max(0.0, (data.time - start) / speed - (perf_counter() - began)))
    return count
