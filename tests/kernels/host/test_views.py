"""Views of arrays behave as Warp arrays and share the memory of the arrays that kernels write."""

import gc
from typing import Any

import numpy as np
import pytest
import warp as wp

from rigcast.kernels.hits.reading import look_up_entries
from rigcast.kernels.host.views import view_as

DEVICES = ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)]
TYPES = {  # type of an array of 6, type and shape of its view
    "scalars": (wp.float32, wp.float32, (2, 3)),
    "integers": (wp.uint16, wp.uint16, (6,)),
    "vectors": (wp.vec3, wp.float32, (2, 3, 3)),
    "vectors in float64": (wp.vec3d, wp.float64, (1, 6, 3)),
    "vectors as vectors": (wp.vec3d, wp.vec3d, (1, 2, 3, 1)),
}


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("what", TYPES)
def test_memory_is_shared(what: str, device: str) -> None:
    dtype, shown_as, shape = TYPES[what]
    array = wp.zeros(6, dtype=dtype, device=device)
    same = view_as(array, shown_as, shape)
    array.fill_(7)
    assert isinstance(same, wp.array)
    assert (same.ptr, same.dtype, same.shape, same.device) == (array.ptr, shown_as, shape, array.device)
    expected = array.numpy().reshape(same.numpy().shape)
    for seen in (same.numpy(), wp.clone(same).numpy(), same.to("cpu").numpy()):
        np.testing.assert_array_equal(seen, expected)


@pytest.mark.parametrize("device", DEVICES)
def test_memory_stays_for_as_long_as_a_view_of_it_exists(device: str) -> None:
    def seen() -> Any:
        return view_as(wp.full(1000, 7.0, dtype=float, device=device), wp.float32, (10, 100)).numpy()

    values = seen()
    gc.collect()
    wp.full(1000, 5.0, dtype=float, device=device)  # takes memory that is free
    assert (values == 7.0).all()


@pytest.mark.parametrize("device", DEVICES)
def test_kernels_accept_views(device: str) -> None:
    given, taken = (view_as(wp.zeros(4, dtype=int, device=device), wp.int32, (4,)) for _ in range(2))
    wp.copy(given, wp.array([2, 0, -1, 1], dtype=int, device=device))
    table = view_as(wp.array([10, 20, 30], dtype=int, device=device), wp.int32, (3,))
    wp.launch(look_up_entries, 4, inputs=[0, 1, table, given], outputs=[taken], device=device)
    assert taken.numpy().tolist() == [30, 10, -1, 20]
    assert np.from_dlpack(taken.to("cpu")).tolist() == taken.list()
    assert str(taken) == "[30 10 -1 20]"


@wp.kernel  # type: ignore[untyped-decorator]
def copy_any(given: wp.array2d[Any], taken: wp.array2d[Any]) -> None:
    i, j = wp.tid()
    taken[i, j] = given[i, j]


@pytest.mark.parametrize("device", DEVICES)
def test_generic_kernels_and_maps_accept_views(device: str) -> None:
    """Warp 1.12 refuses arrays of a subclass of wp.array, so there views are plain arrays."""
    given, taken = (view_as(wp.full(6, value, dtype=float, device=device), wp.float32, (2, 3)) for value in (4.0, 0.0))
    wp.launch(copy_any, (2, 3), inputs=[given], outputs=[taken], device=device)
    assert (taken.numpy() == 4.0).all()
    assert (wp.map(wp.sqrt, given).numpy() == 2.0).all()


@pytest.mark.parametrize("device", DEVICES)
def test_a_view_may_be_empty(device: str) -> None:
    assert view_as(wp.zeros(0, dtype=wp.vec3, device=device), wp.float32, (0, 4, 3)).numpy().shape == (0, 4, 3)
