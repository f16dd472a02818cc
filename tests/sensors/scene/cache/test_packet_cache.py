"""Packets on disk are read if they are of the same rays; else rays are sorted."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.rays.coherent import Packets
from rigcast.sensors.scene.cache import packets as packet_cache
from rigcast.sensors.scene.cache.packets import cached_packets

COUNT = 6000


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RIGCAST_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


@pytest.fixture
def sorts(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list of the numbers of rays of patterns that are sorted, not read."""
    sorted_: list[int] = []

    def sort(directions: NDArray[np.float64], group: NDArray[np.int32] | None) -> Packets:
        sorted_.append(len(directions))
        return sort_into_packets(directions, group)

    monkeypatch.setattr(packet_cache, "sort_into_packets", sort)
    return sorted_


def directions(count: int = COUNT, turn: float = 0.0) -> wp.array:
    angle = np.linspace(0.0, 3.0, count) + turn
    return wp.array(np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1), dtype=wp.vec3d, device="cpu")


def groups(count: int) -> NDArray[np.int32]:
    return (np.arange(COUNT) % count).astype(np.int32)


def packed(directions: wp.array, group: NDArray[np.int32] | None) -> Packets:
    """Packets sorted without the cache."""
    return sort_into_packets(directions.numpy(), group)


def assert_same(got: Packets, expected: Packets) -> None:
    for name in ("tiles", "packets", "singles"):
        a, b = getattr(got, name), getattr(expected, name)
        assert a.dtype is b.dtype, name
        np.testing.assert_array_equal(a.numpy(), b.numpy(), err_msg=name)


@pytest.mark.parametrize("of_several", [False, True])
def test_second_start_reads_the_same_packets(of_several: bool, sorts: list[int]) -> None:
    given = directions(), groups(3) if of_several else None
    cached_packets(*given)
    assert_same(cached_packets(*given), packed(*given))
    assert sorts == [COUNT]


@pytest.mark.parametrize("kept", ["kept", "off"])
def test_sensors_with_the_same_rays_have_the_same_packets(
    kept: str, sorts: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    if kept == "off":
        monkeypatch.setenv("RIGCAST_CACHE", kept)
    first, other = cached_packets(directions(), None), cached_packets(directions(), groups(2))
    assert cached_packets(directions(), None) is first
    assert other is not first
    assert sorts == [COUNT, COUNT]


def test_any_other_rays_are_other_packets(sorts: list[int]) -> None:
    several = (
        (directions(), None),
        (directions(turn=1e-15), None),
        (directions(), groups(2)),
        (directions(), groups(3)),
    )
    for given in several:
        assert_same(cached_packets(*given), packed(*given))
    assert len(sorts) == len(several)


def test_file_of_something_else_is_written_anew(sorts: list[int], folder: Path) -> None:
    cached_packets(directions(), None)
    (file,) = folder.iterdir()
    np.savez(file, tiles=np.zeros(3))
    assert_same(cached_packets(directions(), None), packed(directions(), None))
    cached_packets(directions(), None)
    assert len(sorts) == 2


def test_few_rays_are_not_kept(folder: Path) -> None:
    cached_packets(directions(packet_cache.FEWEST_RAYS - 1), None)
    assert not folder.exists()


def test_off_writes_nothing(folder: Path, sorts: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIGCAST_CACHE", "off")
    for _ in range(2):
        cached_packets(directions(), None)
    assert len(sorts) == 2
    assert not folder.exists()
