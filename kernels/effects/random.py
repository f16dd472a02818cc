"""Random numbers that can be repeated: a function of (seed, sensor, world, frame, ray, draw), never of a stream.

Philox4x32-10 (Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011): ten rounds of

    (c0, c1, c2, c3) -> (hi(M1 c2) ^ c1 ^ k0, lo(M1 c2), hi(M0 c0) ^ c3 ^ k1, lo(M0 c0)),  (k0, k1) += (W0, W1)

turn a counter of four words and a key of two into four words. Here the counter is (draw, ray, frame, world) and the key
is hashed from the seed and the sensor's name. Integers and uniforms have the same bits on every device; normals differ
by the few ulps by which logarithms, sines and cosines do.
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
TWO_PI = wp.constant(6.283185307179586)


@wp.struct
class RandomSource:
    """Which numbers a sensor draws for one frame; made by `random_source`.

    Rays are counted through all worlds: number i is ray i % rays of the world that is called worlds[i / rays].
    """

    key: wp.vec2ui
    frame: wp.uint32
    worlds: wp.array[wp.uint32]
    rays: int


def random_source(
    seed: int, sensor: str, frame: int, worlds: wp.array | None = None, rays: int = 2**31 - 1
) -> RandomSource:
    """The numbers of one frame of one sensor.

    seed: 0 to 2^64 - 1. frame: taken modulo 2^32. The key is BLAKE2b of the name, keyed with the seed.
    worlds: (nworld,) uint32, the worlds in which these numbers are drawn, None for world 0. rays: of each world.
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
    """Philox4x32-10."""
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
    """Four words of 32 random bits."""
    world = wp.uint32(0)
    if source.worlds.shape[0] > 0:
        world = source.worlds[ray / source.rays]
    return philox(wp.vec4ui(wp.uint32(draw), wp.uint32(ray % source.rays), source.frame, world), source.key)


@wp.func
def as_uniform(bits: wp.uint32) -> float:
    """(k + 1/2) / 2^23 of the upper 23 bits k: exact in float32, never 0 or 1, with a mean of exactly 1/2."""
    return (float(bits >> UNUSED_BITS) + 0.5) * (1.0 / 8388608.0)


@wp.func
def random_uniform(source: RandomSource, ray: int, draw: int) -> wp.vec4:
    """Four independent uniform numbers between 0 and 1, both left out."""
    bits = random_bits(source, ray, draw)
    return wp.vec4(as_uniform(bits[0]), as_uniform(bits[1]), as_uniform(bits[2]), as_uniform(bits[3]))


@wp.func
def box_muller(u: float, v: float) -> wp.vec2:
    """Two independent standard normal numbers of two uniform ones: sqrt(-2 ln u) (cos 2 pi v, sin 2 pi v)."""
    radius = wp.sqrt(-2.0 * wp.log(u))
    return wp.vec2(radius * wp.cos(TWO_PI * v), radius * wp.sin(TWO_PI * v))


@wp.func
def random_normal(source: RandomSource, ray: int, draw: int) -> wp.vec4:
    """Four independent standard normal numbers, up to 5.64 in size."""
    u = random_uniform(source, ray, draw)
    first = box_muller(u[0], u[1])
    second = box_muller(u[2], u[3])
    return wp.vec4(first[0], first[1], second[0], second[1])
