"""A reading of beams behind wedges does not change while any of it is held; afterwards its arrays are reused."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rigcast.kernels.packing.wedges import Bending, TurningWedge
from rigcast.kernels.rays.coherent import Packets

LINES = np.array([[1.0, 0.0, 0.0], [0.8, 0.0, 0.6]])
WEDGES = [TurningWedge(-0.3, 1.5, False, 0.02), TurningWedge(0.3, 1.5, True, -0.013)]
SAMPLES = 200
Held = Callable[[NDArray[np.float64], Packets], NDArray[np.generic]]

HELD: dict[str, Held] = {
    "the directions": lambda directions, _: directions,
    "some of the directions": lambda directions, _: directions[3:5, 1],
    "the tiles": lambda _, packets: packets.tiles.numpy(),
    "some of the packets": lambda _, packets: packets.packets[2:4].numpy(),
}


def bending() -> Bending:
    return Bending(LINES, WEDGES, SAMPLES)


def in_packets(beams: Bending, turned: float) -> tuple[NDArray[np.float64], Packets]:
    directions, packets = beams.reading([turned, 2 * turned], True)
    assert packets is not None
    return directions, packets


@pytest.mark.parametrize("what", HELD)
def test_what_is_held_of_a_reading_stays_as_it_is(what: str) -> None:
    beams = bending()
    held = HELD[what](*in_packets(beams, 0.0))
    before = held.copy()
    for k in range(6):
        other = HELD[what](*in_packets(beams, 1.0 + k))
        assert other.tobytes() != before.tobytes(), f"reading {k}"
        assert held.tobytes() == before.tobytes(), f"reading {k}"


def test_arrays_that_nobody_holds_serve_again() -> None:
    beams = bending()
    places = {
        (is_packed, beams.reading([k, -k], is_packed)[0].ctypes.data) for k in range(6) for is_packed in (False, True)
    }
    assert len(places) == 2


def test_a_reading_is_the_same_in_new_arrays_and_in_those_of_another() -> None:
    beams = bending()
    in_packets(beams, 5.0)
    again, again_packed = in_packets(beams, 0.7)
    new, new_packed = in_packets(bending(), 0.7)
    np.testing.assert_array_equal(again, new)
    for name in ("tiles", "packets"):
        got, expected = getattr(again_packed, name).numpy(), getattr(new_packed, name).numpy()
        for field in expected.dtype.names:  # padding between fields is not written
            np.testing.assert_array_equal(got[field], expected[field], err_msg=f"{name}: {field}")
