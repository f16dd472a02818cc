"""Casts of single rays on the CPU with reused launches: preparing one takes as long as casting hundreds of rays."""

from typing import Any

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.launching.slices import OverTiles
from rigcast.kernels.rays.arrays import Rays

from .cast import RAYS_PER_TILE, InSingles, Job, cast_singles


class ReusedCasts:
    """Casts at a geometry that is known at one instant, as it stands when each cast is made.

    A launch is reused once it is done. Casts made at the same time in several Python threads use a launch each.
    """

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self._idle: list[_Cast] = []

    def cast(self, visible: wp.array, rays: Rays, limit: float, cull: int, out: HitArrays | None = None) -> HitArrays:
        """Cast rays without packets; arguments and result as of rigcast.kernels.cast.cast."""
        hits = HitArrays.empty(rays.total, "cpu") if out is None else out
        try:
            one = self._idle.pop()
        except IndexError:
            one = _Cast(self.geometry)
        one.turn_to(visible, rays, limit, cull, hits)
        one.tiles()
        self._idle.append(one)
        return hits


class _Cast:
    """A launch that holds no reference to the rays and hits of its cast; the caller must keep these arrays alive."""

    def __init__(self, geometry: Geometry) -> None:
        self._geometry, self._job, self._these = geometry, Job(), InSingles()
        self.tiles = OverTiles(cast_singles, 0, self._inputs)

    def turn_to(self, visible: wp.array, rays: Rays, limit: float, cull: int, hits: HitArrays) -> None:
        job = self._job.__ctype__()
        job.rays, job.visible = rays.arrays.__ctype__(), visible.__ctype__()
        job.limit, job.cull = limit, cull
        hits.lend(job.out)
        self._these.count, self.tiles.count = rays.total, -(-rays.total // RAYS_PER_TILE)

    def _inputs(self, threads: int) -> list[Any]:
        self._these.copies = wp.empty((threads, 1), dtype=Geometry, device="cpu")
        return [self._geometry, self._job, self._these]
