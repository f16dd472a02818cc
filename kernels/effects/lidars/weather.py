"""Rain and fog in a lidar's beam: their extinction, and their own echoes.

Rain. Drops of diameter D [mm] in rain of R mm/h (Marshall and Palmer, "The distribution of raindrops with size", 1948):

    N(D) = 8000 exp(-4.1 R^-0.21 D)  [1 / (m^3 mm)]

each of which removes twice its cross-section from the beam, as any object does that is large against the wavelength:

    a = integral of 2 (pi D^2 / 4) N(D) dD = 8000 pi 1e-6 / (4.1 R^-0.21)^3  [1/m]

As in LISA (Kilic et al. 2021, arXiv 2107.07004), the beam is a cone of width D_b = b R from 1.5 m on, with b its
divergence and drops larger than 0.05 mm at random places in it. A drop reflects ((n - 1) / (n + 1))^2 with n = 1.328
and returns the power

    P = ((n - 1) / (n + 1))^2 exp(-2 a R) / R^2 min((D / D_b)^2, 1)

The strongest drop in front of the target is the echo of rain. Of the thousands of drops in a long beam only the nearest
DROPS are considered, in the order of the volume v of the cone up to them, which grows by -ln(u) / density from one to
the next.

Fog, after Hahner et al., "Fog simulation on real lidar point clouds for 3D object detection in adverse weather", ICCV
2021, with the meteorological range MOR [m], a pulse of 2 tau = 40 ns and an overlap xi of beam and receiver that rises
from 0 at 0.9 m to 1 at 1 m:

    a = ln(20) / MOR,  b = 0.046 / MOR,  b_0 = 1e-6 / pi
    P(R) = b / b_0 integral over t of sin^2(pi t / 2 tau) xi(r) exp(-2 a r) / r^2,  r = R - c t / 2 before the target

The echo is at the R where P is largest, less c tau / 2, the lag of the pulse's own peak.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.effects.light import SPEED_OF_LIGHT
from rigcast.kernels.effects.random import RandomSource, as_uniform, log_of, random_bits
from rigcast.kernels.launching.slices import prepare_over_runs

from .echoes import Echoes, spread_power

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DROPS = wp.constant(32)
DRAW_DROPS = wp.constant(16)
NEAREST_DROP = wp.constant(1.5)
SMALLEST_DROP = wp.constant(0.05)
DROP_REFLECTIVITY = wp.constant((0.328 / 2.328) ** 2)
CUBE_ROOT_BITS = wp.constant(709_921_077)  # two thirds of the bits of 1.0f, less the error of a straight line
FOG_STEP = wp.constant(0.1)  # [m] between targets in the table of fog echoes
_FOG_REACH = 20.0
_HALF_PULSE = 20e-9


@wp.struct
class Rain:
    """Rain. density: of drops [1/m^3], 0 for none. slope: 4.1 R^-0.21 [1/mm]. divergence: full beam width [rad]."""

    density: float
    slope: float
    divergence: float


@wp.struct
class Fog:
    """Table of fog echoes: entry k for a target at the range k FOG_STEP, the last also for all beyond. Empty for no
    fog."""

    distance: wp.array[float]  # range of the echo [m], +inf for none
    power: wp.array[float]


def drop_slope(rain_rate: float) -> float:
    """The slope 4.1 R^-0.21 [1/mm] of the drop-size distribution in rain of R mm/h."""
    return 4.1 * rain_rate**-0.21


def rain_of(rain_rate: float, divergence: float) -> Rain:
    """Rain of rain_rate [mm/h] in a beam of this divergence [rad]."""
    rain = Rain()
    rain.divergence = divergence
    rain.slope = drop_slope(rain_rate) if rain_rate > 0 else 1.0
    rain.density = 8000 / rain.slope * math.exp(-rain.slope * SMALLEST_DROP) if rain_rate > 0 else 0.0
    return rain


def rain_extinction(rain_rate: float) -> float:
    """Extinction a [1/m] of rain of R mm/h, from its drop-size distribution."""
    return 8000 * math.pi * 1e-6 / drop_slope(rain_rate) ** 3 if rain_rate > 0 else 0.0


def fog_extinction(visibility: float) -> float:
    """Extinction a = ln(20) / MOR [1/m] of fog with visibility MOR [m]."""
    return math.log(20) / visibility


@dataclass(frozen=True)
class FogResponse:
    """Range [m] and power, (n,) each, of the echo of fog in front of a target at the range k FOG_STEP."""

    distance: npt.NDArray[np.float32]
    power: npt.NDArray[np.float32]


def fog_response(visibility: float, extinction: float) -> FogResponse:
    """The strongest echo of fog with visibility MOR [m]. extinction: of everything in the air [1/m]."""
    step = 0.01
    r = np.arange(step, _FOG_REACH, step)
    overlap = np.clip((r - 0.9) / 0.1, 0, 1)
    spread = overlap * np.exp(-2 * extinction * r) / r**2
    lag = np.arange(0, SPEED_OF_LIGHT * _HALF_PULSE, step)  # c t / 2
    pulse = np.sin(np.pi * lag / (SPEED_OF_LIGHT * _HALF_PULSE)) ** 2
    backscatter = (0.046 / visibility) / (1e-6 / np.pi)
    targets = np.arange(int(_FOG_REACH / FOG_STEP)) * FOG_STEP
    responses = np.array([np.convolve(np.where(r <= target, spread, 0), pulse) for target in targets])
    peak = responses.argmax(axis=1)
    power = backscatter * responses.max(axis=1) * step * 2 / SPEED_OF_LIGHT
    distance = np.where(power > 0, r[0] + peak * step - SPEED_OF_LIGHT * _HALF_PULSE / 2, np.inf)
    return FogResponse(distance.astype(np.float32), power.astype(np.float32))


def fog_of(response: FogResponse | None, device: wp.DeviceLike) -> Fog:
    """The table of fog echoes on a device; empty for None."""
    fog = Fog()
    nothing = np.zeros(0, np.float32)
    fog.distance = wp.array(nothing if response is None else response.distance, dtype=float, device=device)
    fog.power = wp.array(nothing if response is None else response.power, dtype=float, device=device)
    return fog


@wp.func
def drop_power(distance: float, diameter: float, divergence: float, extinction: float) -> float:
    """Power of the echo of a drop of this diameter [mm] at a distance [m]."""
    share = 1.0e-3 * diameter / (divergence * distance)
    return spread_power(DROP_REFLECTIVITY * wp.min(share * share, 1.0), distance, extinction)


@wp.func
def cube_root(x: float) -> float:
    """Cube root of a positive number, not subnormal: an estimate from a third of its bits, then two Halley steps."""
    y = wp.cast(wp.cast(x, int) / 3 + CUBE_ROOT_BITS, float)
    for _ in range(2):
        cube = y * y * y
        y *= (cube + 2.0 * x) / (2.0 * cube + x)
    return y


@wp.func
def strongest_drop(rain: Rain, source: RandomSource, i: int, target: float, extinction: float) -> wp.vec2:
    """Range [m] and power of the strongest drop in front of a target at this range [m]; +inf and 0 if there is none."""
    per_volume = 12.0 / (wp.PI * rain.divergence * rain.divergence)
    cube = float(NEAREST_DROP * NEAREST_DROP * NEAREST_DROP)
    best = wp.vec2(wp.inf, 0.0)
    if target <= NEAREST_DROP:
        return best
    limit = target * target * target
    for k in range(DROPS):
        bits = random_bits(source, i, DRAW_DROPS + k)
        cube = cube - log_of(as_uniform(bits[0])) / rain.density * per_volume
        if cube >= limit:
            return best
        distance = cube_root(cube)
        diameter = SMALLEST_DROP - log_of(as_uniform(bits[1])) / rain.slope
        power = drop_power(distance, diameter, rain.divergence, extinction)
        if power > best[1]:
            best = wp.vec2(distance, power)
    return best


@wp.func
def scatter_beam(
    i: int, rain: Rain, fog: Fog, source: RandomSource, extinction: float, beams: int, first_slot: int, echoes: Echoes
) -> None:
    """Write the echo of rain in beam i to slot first_slot and that of fog to first_slot + 1.

    The target is the echo in slot 0, of the beam's middle sub-ray. Without an echo of rain or fog, or with a target of
    NaN, the distance is +inf and the power 0. shape and face are -1, the normal is 0.
    """
    target = echoes.distance[i]
    drop = wp.vec2(wp.inf, 0.0)
    if rain.density > 0.0 and not wp.isnan(target):
        drop = strongest_drop(rain, source, i, target, extinction)
    haze = wp.vec2(wp.inf, 0.0)
    if fog.distance.shape[0] > 0 and not wp.isnan(target):
        k = int(wp.min(target / FOG_STEP, float(fog.distance.shape[0] - 1)))
        haze = wp.vec2(fog.distance[k], fog.power[k])
    for m in range(2):
        slot = (first_slot + m) * beams + i
        echo = drop
        if m == 1:
            echo = haze
        echoes.distance[slot] = echo[0]
        echoes.power[slot] = echo[1]
        echoes.shape[slot] = -1
        echoes.face[slot] = -1
        echoes.normal[slot] = wp.vec3(0.0, 0.0, 0.0)


@wp.kernel
def scatter(
    first: int,
    run: int,  # beams per thread
    rain: Rain,
    fog: Fog,
    source: RandomSource,
    extinction: float,
    beams: int,
    first_slot: int,
    echoes: Echoes,
) -> None:
    """Write the echoes of rain and fog of all beams; see `scatter_beam`."""
    i = (first + wp.tid()) * run
    end = wp.min(i + run, beams)
    while i < end:
        scatter_beam(i, rain, fog, source, extinction, beams, first_slot, echoes)
        i += 1


def prepare_weather(
    rain: Rain, fog: Fog, source: RandomSource, extinction: float, echoes: Echoes, beams: int, first_slot: int
) -> Callable[[], object]:
    """A repeatable launch that writes the echoes of rain and fog in front of each beam's first hit to slots first_slot
    and first_slot + 1.

    source: read anew at each launch. extinction: of everything in the air [1/m]. The hit is that of the middle sub-ray,
    in slot 0.
    """
    inputs = [rain, fog, source, extinction, beams, first_slot]
    return prepare_over_runs(scatter, beams, inputs, [echoes], echoes.distance.device)
