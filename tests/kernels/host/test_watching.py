"""A change to a watched array is reported until it is taken, with any number of threads."""

import numpy as np
import pytest

from rigcast.kernels.host.watching import PIECE, Watched
from rigcast.kernels.launching.slices import TURN

HEIGHTS_PER_TURN = PIECE * TURN // 4
"""Number of float32 values that a thread compares per turn."""
SIZES = 3, 1001, 517, 0, 3 * HEIGHTS_PER_TURN + 5


def arrays_of(seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [rng.random(size, np.float32) for size in SIZES]


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("value", [np.nan, -0.0, 1e-45, 7.0], ids=str)
@pytest.mark.parametrize(
    ("array", "place"),
    [
        (0, 0),
        (0, 2),
        (1, 0),
        (1, 1000),
        (2, 516),
        (4, 0),
        (4, PIECE // 4 - 1),
        (4, PIECE // 4),
        (4, 2 * HEIGHTS_PER_TURN),
        (4, -1),
    ],
)
def test_one_number_that_is_written_is_seen_until_it_is_taken(
    array: int, place: int, value: float, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIGCAST_THREADS", str(threads))
    arrays = [np.zeros(size, np.float32) for size in SIZES]
    watched = Watched(arrays)
    assert not watched.have_changed()
    arrays[array][place] = value
    assert watched.have_changed()
    assert watched.have_changed()
    watched.taken()
    assert not watched.have_changed()
    arrays[array][place] = 0.0
    assert watched.have_changed()


@pytest.mark.parametrize(
    ("name", "places"), {"two": 2, "a row": 64, "every 16th, of one number of a digest": slice(None, None, 16)}.items()
)
@pytest.mark.parametrize("change", [np.negative, np.sqrt, lambda a: a + np.float32(1)], ids=["-a", "sqrt a", "a + 1"])
def test_many_numbers_that_are_written_do_not_cancel_each_other(
    name: str, places: int | slice, change: np.ufunc
) -> None:
    for seed in range(20):
        arrays = arrays_of(seed)
        watched = Watched(arrays)
        first = np.random.default_rng(seed).integers(0, HEIGHTS_PER_TURN)
        which = places if isinstance(places, slice) else first + 16 * np.arange(places)
        arrays[4][which] = change(arrays[4][which])
        assert watched.have_changed(), f"seed {seed}, {name}"


def test_numbers_that_change_places_are_seen() -> None:
    for apart in (1, 8, 16, 64, PIECE // 4, HEIGHTS_PER_TURN):
        arrays = arrays_of(apart)
        watched = Watched(arrays)
        arrays[4][[7, 7 + apart]] = arrays[4][[7 + apart, 7]]
        assert watched.have_changed(), f"{apart} apart"
