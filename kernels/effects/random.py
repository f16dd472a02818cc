"""Repeatable random numbers: a function of (seed, sensor, world, frame, ray, draw), never of a stream.

Philox4x32-10 (Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011): ten rounds of

    (c0, c1, c2, c3) -> (hi(M1 c2) ^ c1 ^ k0, lo(M1 c2), hi(M0 c0) ^ c3 ^ k1, lo(M0 c0)),  (k0, k1) += (W0, W1)

turn a counter of four words and a key of two into four words. The counter is (draw, ray, frame, world); the key is
hashed from the seed and the sensor's name. Logarithms, sines and cosines are polynomials of sums and products, and
square roots are correctly rounded. So all numbers have the same bits on every device, and loops over rays are
vectorised.
"""

import hashlib

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

M0 = wp.constant(wp.uint64(0xD2511F53))
M1 = wp.constant(wp.uint64(0xCD9E8D57))
W0 = wp.constant(wp.uint32(0x9E3779B9))
W1 = wp.constant(wp.uint32(0xBB67AE85))
WORD = wp.constant(wp.uint64(32))
UNUSED_BITS = wp.constant(wp.uint32(9))
SQRT_HALF_BITS, MANTISSA_BITS = wp.constant(0x3F3504F3), wp.constant(23)  # of a float32
LN_2, LN_2_REST = wp.constant(0.693359375), wp.constant(-2.12194440e-4)  # sum: ln 2; an exponent times LN_2 is exact
QUARTER = wp.constant(1.5707963267948966)  # of a turn [rad]


@wp.struct
class RandomSource:
    """The random numbers of a sensor for one frame; made by `random_source`.

    Rays are counted over all worlds: ray i is ray i % rays of world worlds[i / rays].
    """

    key: wp.vec2ui
    frame: wp.uint32
    worlds: wp.array[wp.uint32]
    rays: int


def random_source(
    seed: int, sensor: str, frame: int, worlds: wp.array | None = None, rays: int = 2**31 - 1
) -> RandomSource:
    """The source of a sensor's random numbers for one frame. Its key is BLAKE2b of the name, keyed with the seed.

    Args:
        seed: 0 to 2^64 - 1.
        sensor: the sensor's name.
        frame: number of the frame; taken modulo 2^32.
        worlds: (nworld,) uint32, numbers of the worlds; None for world 0.
        rays: number of rays per world.
    """
    digest = hashlib.blake2b(sensor.encode(), digest_size=8, key=seed.to_bytes(8, "little")).digest()
    source = RandomSource()
    source.key = wp.vec2ui(int.from_bytes(digest[:4], "little"), int.from_bytes(digest[4:], "little"))
    source.frame = wp.uint32(frame % 2**32)
    source.rays = rays
    if worlds is not None:
        source.worlds = worlds
    return source


@wp.func
def philox(counter: wp.vec4ui, key: wp.vec2ui) -> wp.vec4ui:
    """Four random words by Philox4x32-10."""
    c = counter
    k = key
    for _ in range(10):
        p0 = M0 * wp.uint64(c[0])
        p1 = M1 * wp.uint64(c[2])
        c = wp.vec4ui(
            wp.uint32(p1 >> WORD) ^ c[1] ^ k[0], wp.uint32(p1), wp.uint32(p0 >> WORD) ^ c[3] ^ k[1], wp.uint32(p0)
        )
        k = wp.vec2ui(k[0] + W0, k[1] + W1)
    return c


@wp.func
def random_bits(source: RandomSource, ray: int, draw: int) -> wp.vec4ui:
    """Four words of 32 random bits for a ray, counted over all worlds."""
    world = wp.uint32(0)
    if source.worlds.shape[0] > 0:
        world = source.worlds[ray / source.rays]
    return philox(wp.vec4ui(wp.uint32(draw), wp.uint32(ray % source.rays), source.frame, world), source.key)


@wp.func
def as_uniform(bits: wp.uint32) -> float:
    """A uniform number (k + 1/2) / 2^23 from the upper 23 bits k: exact in float32, never 0 or 1, mean exactly 1/2."""
    return (float(bits >> UNUSED_BITS) + 0.5) * (1.0 / 8388608.0)


@wp.func
def log_of(u: float) -> float:
    """ln u for u in (0, 1), not subnormal, with an error of at most an ulp of 1 + |ln u|.

    With u = 2^k m, m = 1 + x in [sqrt 1/2, sqrt 2), it is k ln 2 + ln m; ln m by the polynomial of Cephes' logf
    (Moshier).
    """
    bits = wp.cast(u, int)
    power = (bits - SQRT_HALF_BITS) >> MANTISSA_BITS
    x = wp.cast(bits - (power << MANTISSA_BITS), float) - 1.0
    p = 7.0376836292e-2 * x - 1.1514610310e-1
    p = p * x + 1.1676998740e-1
    p = p * x - 1.2420140846e-1
    p = p * x + 1.4249322787e-1
    p = p * x - 1.6668057665e-1
    p = p * x + 2.0000714765e-1
    p = p * x - 2.4999993993e-1
    p = p * x + 3.3333331174e-1
    k = float(power)
    return x + ((p * x * x * x + k * LN_2_REST) - 0.5 * x * x) + k * LN_2


@wp.func
def cosine_of(v: float, quarters: int) -> float:
    """cos(2 pi v - quarters pi / 2) for v in (0, 1), with an error of at most an ulp of 1.

    It uses the polynomials of Cephes' cosf and sinf on the remainder after whole quarter turns.
    """
    nearest = int(4.0 * v + 0.5)
    angle = (4.0 * v - float(nearest)) * QUARTER
    z = angle * angle
    cosine = 1.0 - 0.5 * z + z * z * (4.166664568298827e-2 + z * (-1.388731625493765e-3 + z * 2.443315711809948e-5))
    sine = angle + angle * z * (-1.6666654611e-1 + z * (8.3321608736e-3 + z * -1.9515295891e-4))
    turns = nearest - quarters
    size = wp.where((turns & 1) != 0, sine, cosine)
    return wp.where(((turns + 1) & 2) != 0, -size, size)


@wp.func
def normal_radius(u: float) -> float:
    """The radius sqrt(-2 ln u) of Box and Muller's method."""
    return wp.sqrt(-2.0 * log_of(u))


@wp.func
def random_numbers(source: RandomSource, ray: int, draw: int) -> wp.vec4:
    """Two standard normal numbers, at most 5.77 in size, and two uniform ones in (0, 1), all independent.

    The normal ones are sqrt(-2 ln u) (cos 2 pi v, sin 2 pi v) from uniform u and v (Box and Muller, 1958).
    """
    bits = random_bits(source, ray, draw)
    radius = normal_radius(as_uniform(bits[0]))
    v = as_uniform(bits[1])
    return wp.vec4(radius * cosine_of(v, 0), radius * cosine_of(v, 1), as_uniform(bits[2]), as_uniform(bits[3]))
