"""Charts of the results. Needs matplotlib, the extra `plot`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rigcast.bench.race import Result
from rigcast.bench.scaling import Series
from rigcast.sensors.extras import load_extra

_LIBRARY = {"Open3D": "Open3D (Embree)"}


def draw_results(results: Sequence[Result], path: Path) -> None:
    """Write a PNG of bars, M rays/s on a logarithmic axis: for each sensor of each workload, each caster."""
    figure = _figure(9, 1 + 0.28 * sum(len(result.speeds) for result in results))
    axes = figure.subplots()
    names = list(dict.fromkeys(speed.caster for result in results for speed in result.speeds))
    at, ticks, labels = 0.0, [], []
    for result in results:
        ticks.append(at + (len(result.speeds) - 1) / 2)
        labels.append(f"{result.workload}\n{result.sensor}, {' x '.join(map(str, result.shape))}")
        for speed in result.speeds:
            value = speed.mrays
            error = [[value.median - value.lowest], [value.highest - value.median]]
            axes.barh(at, value.median, xerr=error, color=f"C{names.index(speed.caster)}", height=0.85)
            axes.text(value.highest * 1.05, at, f"{value.median:.3g}", va="center", fontsize=8)
            at += 1
        at += 0.7
    axes.set(xscale="log", xlabel="M rays/s", yticks=ticks, yticklabels=labels)
    axes.margins(y=0.01)
    axes.invert_yaxis()
    handles = [axes.barh(0, 0, color=f"C{k}", label=_LIBRARY.get(name, name)) for k, name in enumerate(names)]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(names), frameon=False)
    figure.savefig(path, dpi=120)


def draw_scaling(series: Sequence[Series], path: Path) -> None:
    """Write a PNG with a plot for each series: M rays/s over the varied size, both logarithmic."""
    figure = _figure(3.2 * len(series), 3)
    for axes, one in zip(figure.subplots(1, len(series), squeeze=False)[0], series, strict=True):
        _plot(axes, one)
    figure.savefig(path, dpi=120)


def draw_worlds(ways: Mapping[str, Series], path: Path) -> None:
    """Write a PNG with M rays/s of each way to cast over the number of worlds, both logarithmic."""
    figure = _figure(6, 4)
    axes = figure.subplots()
    for name, series in ways.items():
        _plot(axes, series, name)
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    figure.savefig(path, dpi=120)


def _plot(axes: Any, series: Series, label: str | None = None) -> None:
    ticker = load_extra("a chart", "matplotlib.ticker", "plot")
    median, lowest, highest = ([getattr(s, name) for s in series.mrays] for name in ("median", "lowest", "highest"))
    axes.plot(series.sizes, median, "o-", label=label)
    axes.fill_between(series.sizes, lowest, highest, alpha=0.2)
    axes.set(xscale="log", yscale="log", xlabel=series.varies, ylabel="M rays/s")
    axes.set_xticks(series.sizes, minor=False)
    axes.set_xticks([], minor=True)
    axes.xaxis.set_major_formatter(ticker.EngFormatter(places=0, sep=""))
    for which in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        which(ticker.LogFormatter(labelOnlyBase=False))  # 20, not 2 x 10^1
    axes.grid(alpha=0.3, which="both")


def _figure(width: float, height: float) -> Any:
    load_extra("a chart", "matplotlib", "plot")
    from matplotlib.figure import Figure  # with no window and no state of pyplot's

    return Figure(figsize=(width, height), layout="constrained")
