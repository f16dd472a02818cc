"""Selection of the returns that a receiver reports from the echoes of each beam.

A receiver does not separate echoes closer than the gap c tau / 2 of a pulse of length tau. Such a group of echoes is
one return: its power is their sum and its range their mean weighted by power, which lies between the surfaces that a
beam straddles (a mixed pixel). Of the groups with at least the detectable power, it reports the first, the last, the
strongest, or two. Slots are laid out as in rigcast.kernels.effects.lidars.echoes.Echoes.
"""

from collections.abc import Callable

import warp as wp

from rigcast.kernels.launching.slices import prepare_over_runs

from .echoes import Echoes

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FIRST = wp.constant(0)
LAST = wp.constant(1)
STRONGEST = wp.constant(2)
DUAL = wp.constant(3)
WEAKEST = wp.constant(1.0e-20)  # least weight of an echo, so that black surfaces have a range


@wp.struct
class Return:
    """A group of echoes.

    distance: range [m], +inf for none. power: sum of the powers, -1 for none. slot: index of its strongest echo in
    Echoes' arrays, -1 for none. end: range of its last echo [m].
    """

    distance: float
    power: float
    slot: int
    end: float


@wp.func
def no_return() -> Return:
    none = Return()
    none.distance = wp.inf
    none.power = -1.0
    none.slot = -1
    none.end = wp.inf
    return none


@wp.func
def group_extent(echoes: Echoes, i: int, beams: int, gap: float, after: float) -> wp.vec2:
    """The nearest and farthest range of the nearest group of echoes beyond a range; +inf if there is none."""
    slots = echoes.distance.shape[0] / beams
    start = float(wp.inf)
    for q in range(slots):
        d = echoes.distance[q * beams + i]
        if d > after and d < start:
            start = d
    end = float(start)
    grows = bool(start < wp.inf)
    while grows:
        farther = float(end)
        for q in range(slots):
            d = echoes.distance[q * beams + i]
            if d <= end + gap:
                farther = wp.max(farther, d)
        grows = farther > end
        end = farther
    return wp.vec2(start, end)


@wp.func
def next_group(echoes: Echoes, i: int, beams: int, gap: float, after: float) -> Return:
    """The nearest group of echoes of beam i beyond a range `after` [m]; `no_return()` if there is none."""
    extent = group_extent(echoes, i, beams, gap, after)
    group = no_return()
    if extent[0] == wp.inf:
        return group
    group.end = extent[1]
    group.power = 0.0
    best = float(-1.0)
    weights = float(0.0)
    moment = float(0.0)
    for q in range(echoes.distance.shape[0] / beams):
        slot = q * beams + i
        d = echoes.distance[slot]
        if d >= extent[0] and d <= extent[1]:
            power = echoes.power[slot]
            weight = wp.max(power, WEAKEST)
            group.power += power
            weights += weight
            moment += weight * (d - extent[0])
            if power > best:
                best = power
                group.slot = slot
    group.distance = extent[0] + moment / weights
    return group


@wp.func
def write_return(r: Return, k: int, echoes: Echoes, returns: Echoes) -> None:
    """Write return k with the surface of its strongest echo; without one power is 0, shape and face -1, normal 0."""
    returns.distance[k] = r.distance
    returns.power[k] = wp.max(r.power, 0.0)
    returns.shape[k] = -1
    returns.face[k] = -1
    returns.normal[k] = wp.vec3(0.0, 0.0, 0.0)
    if r.slot >= 0:
        returns.shape[k] = echoes.shape[r.slot]
        returns.face[k] = echoes.face[r.slot]
        returns.normal[k] = echoes.normal[r.slot]


@wp.func
def choose_only(echoes: Echoes, i: int, least_power: float, mode: int, returns: Echoes) -> None:
    """`choose_among` for beams with a single slot, in a fraction of its time."""
    only = no_return()
    none = no_return()
    d = echoes.distance[i]
    if d < wp.inf and echoes.power[i] >= least_power:
        only.distance = d
        only.power = echoes.power[i]
        only.slot = i
    if wp.isnan(d):
        only.distance = d
        none.distance = d
    if mode == DUAL:
        write_return(only, 2 * i, echoes, returns)
        write_return(none, 2 * i + 1, echoes, returns)
    else:
        write_return(only, i, echoes, returns)


@wp.func
def choose_among(
    echoes: Echoes, i: int, beams: int, gap: float, least_power: float, mode: int, returns: Echoes
) -> None:
    """Write the returns of beam i.

    Groups of echoes are visited from near to far; those with less than least_power are skipped. Of the others,

    - FIRST and LAST report the nearest and the farthest;
    - STRONGEST reports the one of largest power, of equal ones the nearest;
    - DUAL reports the strongest as return 0 and the last as return 1, or, if these are the same, the second strongest
      as return 1. With a single group, return 1 has no echo.

    A return without an echo has distance +inf. If the beam is not finite (distance NaN in slot 0), all are NaN.
    """
    first = no_return()
    last = no_return()
    strongest = no_return()
    second = no_return()
    group = next_group(echoes, i, beams, gap, -1.0)
    while group.slot >= 0:
        if group.power >= least_power:
            if first.slot < 0:
                first = group
            last = group
            if group.power > strongest.power:
                second = strongest
                strongest = group
            elif group.power > second.power:
                second = group
        group = next_group(echoes, i, beams, gap, group.end)
    if wp.isnan(echoes.distance[i]):
        first.distance = wp.nan
        last.distance = wp.nan
        strongest.distance = wp.nan
        second.distance = wp.nan
    if mode == FIRST:
        write_return(first, i, echoes, returns)
    elif mode == LAST:
        write_return(last, i, echoes, returns)
    elif mode == STRONGEST:
        write_return(strongest, i, echoes, returns)
    else:
        other = second
        if last.slot != strongest.slot:
            other = last
        write_return(strongest, 2 * i, echoes, returns)
        write_return(other, 2 * i + 1, echoes, returns)


@wp.kernel
def choose_returns(
    first: int,
    run: int,  # beams per thread
    echoes: Echoes,
    beams: int,
    gap: float,
    least_power: float,
    mode: int,
    returns: Echoes,
) -> None:
    """Write the returns of all beams; see `choose_among`."""
    i = (first + wp.tid()) * run
    end = wp.min(i + run, beams)
    is_one = echoes.distance.shape[0] == beams
    while i < end:
        if is_one:
            choose_only(echoes, i, least_power, mode, returns)
        else:
            choose_among(echoes, i, beams, gap, least_power, mode, returns)
        i += 1


def prepare_choice(
    echoes: Echoes, beams: int, gap: float, least_power: float, mode: int, returns: Echoes
) -> Callable[[], object]:
    """A repeatable launch that writes the returns of each beam; see `choose_among`.

    Args:
        echoes: (slots * beams,), see Echoes.
        gap: distance [m] up to which an echo belongs to the group of the one before it.
        least_power: of a return, in units of `Echoes.power`.
        mode: FIRST, LAST, STRONGEST or DUAL.
        returns: out, read anew at each launch: entry i, or for DUAL entries 2 i and 2 i + 1, are those of beam i.
    """
    inputs = [echoes, beams, gap, least_power, mode]
    return prepare_over_runs(choose_returns, beams, inputs, [returns], echoes.distance.device)
