"""Measurement of returns by a lidar's receiver: range with noise, resolution and limits; intensity; losses.

The range R of a return of power P has a normal error of variance

    range_std^2 + dR^2 / (2 SNR) + (k (1 - exp(-rain))^2 R)^2,   SNR = P / P_min

where the second term is from Kilic et al. 2021 (arXiv 2107.07004) and the third from Goodin et al., "Predicting the
influence of rain on LIDAR in ADAS", Electronics 8(1), 2019. A return is lost with the probability

    1 - (1 - dropout) (1 - dark_dropout max(0, 1 - intensity / dark_limit))

where the second factor is that of CARLA's lidar. Intensity is P R^2: the reflectivity of a surface that would return
the same power facing the sensor in clear air.
"""

import warp as wp

from rigcast.kernels.effects.draws import Draws, prepare_draws
from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.launching.slices import prepare_over_runs

from .echoes import Echoes

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DRAW_RETURN = wp.constant(1)  # the second return uses the next one


@wp.struct
class RangeNoise:
    """Parameters of the module's equations."""

    range_std: float  # [m]
    power_std: float  # dR sqrt(P_min / 2) [m]
    rain_std: float  # k (1 - exp(-rain))^2, a share of the range
    resolution: float  # ranges are rounded to multiples of it [m]; 0 for none
    dropout: float  # probability
    dark_dropout: float  # probability at intensity 0
    dark_limit: float  # intensity from which dark_dropout has no effect


@wp.func
def measure_return(
    k: int, numbers: wp.vec4, noise: RangeNoise, min_range: float, max_range: float, returns: Echoes
) -> None:
    """Turn return k into a measurement in place.

    The distance [m] gets noise and is rounded; it becomes +inf if the return is lost or beyond max_range, -inf below
    min_range; one that is not finite stays. The power becomes the intensity, 0 without a reading. Where a reading is
    dropped, the shape becomes -1 and the normal 0. numbers: of the return, see `draws.drawn`.
    """
    d = returns.distance[k]
    intensity = returns.power[k] * d * d
    returns.power[k] = 0.0
    if not wp.isfinite(d):
        return
    keep = (1.0 - noise.dropout) * (1.0 - noise.dark_dropout * wp.max(0.0, 1.0 - intensity / noise.dark_limit))
    by_power = 0.0
    if noise.power_std > 0.0:
        by_power = noise.power_std * noise.power_std * d * d / intensity
    by_rain = noise.rain_std * d
    std = wp.sqrt(noise.range_std * noise.range_std + by_power + by_rain * by_rain)
    if std > 0.0:
        d += std * numbers[0]
    if noise.resolution > 0.0:
        d = noise.resolution * wp.rint(d / noise.resolution)
    is_lost = numbers[2] > keep or d > max_range
    returns.distance[k] = d
    if is_lost:
        returns.distance[k] = wp.inf
    elif d < min_range:
        returns.distance[k] = -wp.inf
    if is_lost or d < min_range:
        returns.shape[k] = -1
        returns.normal[k] = wp.vec3(0.0, 0.0, 0.0)
    else:
        returns.power[k] = intensity


@wp.kernel
def measure_returns(
    first: int,
    run: int,  # returns per thread
    noise: RangeNoise,
    draws: Draws,  # of the first return of all beams, then of the second
    per_beam: int,
    min_range: float,
    max_range: float,
    returns: Echoes,  # in and out
) -> None:
    """Turn all returns into measurements; see `measure_return`."""
    k = (first + wp.tid()) * run
    end = wp.min(k + run, returns.distance.shape[0])
    beams = returns.distance.shape[0] / per_beam
    while k < end:
        at = k
        if per_beam > 1:
            at = k % per_beam * beams + k / per_beam
        measure_return(k, draws.numbers[at], noise, min_range, max_range, returns)
        k += 1


class Measurement:
    """A repeatable measurement of the returns of `beams` beams, in place.

    The distance [m] becomes +inf if a return is lost or beyond the upper limit, -inf below the lower one; +inf and NaN
    stay. The power becomes the intensity P R^2, 0 where there is no reading.

    Args:
        returns: read anew at each launch; return k of beam i is entry i * per_beam + k.
        source: random numbers, read anew likewise.
        limits: (min_range, max_range) [m].
    """

    def __init__(
        self,
        returns: Echoes,
        beams: int,
        per_beam: int,
        noise: RangeNoise,
        source: RandomSource,
        limits: tuple[float, float],
        device: wp.DeviceLike,
    ) -> None:
        draws, self._draw = prepare_draws(source, DRAW_RETURN, beams, device, per_beam)
        inputs = [noise, draws, per_beam, *limits]
        self._measure = prepare_over_runs(measure_returns, per_beam * beams, inputs, [returns], device)

    def __call__(self) -> None:
        for draw in self._draw:
            draw()
        self._measure()
