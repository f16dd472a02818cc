"""Plots of frames by matplotlib, for notebooks and papers."""

from types import NoneType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import require_type
from rigcast.sensors.extras import load_extra
from rigcast.sensors.preview.camera import depth_or_range
from rigcast.sensors.preview.colour import Scale
from rigcast.sensors.preview.lidar import first_returns, picture_order
from rigcast.sensors.specs.pattern import Pattern, azimuth_elevation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def titled_axes(ax: "Axes | None", sensor: str, time: float) -> "Axes":
    """The axes `ax`, or the current ones for None, with the title of a frame.

    Raises InputError if matplotlib is not installed, and for anything but axes.
    """
    pyplot = load_extra("Frame.plot", "matplotlib.pyplot", "plot")
    require_type("Frame.plot: ax", ax, pyplot.Axes, NoneType)
    shown: Axes = pyplot.gca() if ax is None else ax
    shown.set_title(f"{sensor}, t = {time:.3f} s")
    return shown


def plot_depth(ax: "Axes", depth: NDArray[np.float32], distance: NDArray[np.float32]) -> None:
    """Plot the z-depth (H, W) [m] of a camera, or the ranges if it sees behind itself."""
    shown, name = depth_or_range(depth, distance)
    _image(ax, shown, f"{name} [m]")
    ax.set(xlabel="u [pixels]", ylabel="v [pixels]")


def plot_ranges(ax: "Axes", every: NDArray[np.float32], pattern: Pattern) -> None:
    """Plot the range image of a lidar, from the first return of each ray. every: (...) [m], ranges of all returns."""
    draw_ranges = _range_image if len(pattern.shape) == 2 else _range_scatter
    draw_ranges(ax, first_returns(every, pattern), pattern)


def plot_from_above(ax: "Axes", points: NDArray[np.float32]) -> None:
    """Plot points (n, 3) [m] from above, x forward up and y to the left, coloured by height."""
    points = points[np.isfinite(points).all(axis=1)]
    drawn = ax.scatter(points[:, 1], points[:, 0], c=points[:, 2], s=4, cmap="turbo")
    ax.invert_xaxis()
    ax.set(xlabel="y [m]", ylabel="x [m]", aspect="equal")
    ax.figure.colorbar(drawn, ax=ax, label="z [m]")


def _range_image(ax: "Axes", distance: NDArray[np.float32], pattern: Pattern) -> None:
    order, azimuth = picture_order(pattern.directions)
    _image(ax, distance[order], "range [m]", aspect="auto")
    degrees, rows = np.rad2deg(azimuth), order[0][:, 0]
    ticks = np.linspace(0, len(degrees) - 1, min(9, len(degrees))).astype(int)
    ax.set_xticks(ticks, [f"{degrees[k]:.0f}" for k in ticks])
    ax.set_yticks([0, len(rows) - 1], [f"ring {rows[0]}", f"ring {rows[-1]}"])
    ax.set_xlabel("azimuth [deg]")


def _range_scatter(ax: "Axes", distance: NDArray[np.float32], pattern: Pattern) -> None:
    """Plot each ray as a dot at its azimuth (left is left) and elevation."""
    azimuth, elevation = (np.rad2deg(angle) for angle in azimuth_elevation(pattern.directions))
    hit = np.isfinite(distance)
    ax.scatter(azimuth[~hit], elevation[~hit], s=1, c="grey")
    drawn = ax.scatter(azimuth[hit], elevation[hit], s=1, c=distance[hit], cmap="turbo_r")
    ax.invert_xaxis()
    ax.set(xlabel="azimuth [deg]", ylabel="elevation [deg]", aspect="equal")
    ax.figure.colorbar(drawn, ax=ax, label="range [m]")


def _image(ax: "Axes", values: NDArray[np.float32], label: str, **how: Any) -> None:
    """Plot values with a colour bar, near ones warm; values that are not finite are grey."""
    scale = Scale.of(values)
    low, high = (scale.low, scale.high) if np.isfinite(scale.low) else (0.0, 1.0)
    masked = np.ma.masked_invalid(values)
    drawn = ax.imshow(masked, cmap="turbo_r", vmin=low, vmax=high, interpolation="nearest", **how)
    ax.set_facecolor("grey")
    ax.figure.colorbar(drawn, ax=ax, label=label)
