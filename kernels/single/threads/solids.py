"""`triage_closed_form` for CUDA, with the sphere, from which round forms are made, called instead of inlined.

Inlined, its code would be there six times, and threads stall on instructions that are not in the cache. On the CPU
it is inlined.
"""

from types import FunctionType
from typing import Any

import warp as wp

from rigcast.kernels.inline import noinline
from rigcast.kernels.shapes import crossings, solids


def _again(function: Any, make: Any = wp.func, **names: Any) -> Any:
    """A copy of a Warp function under another name, in which these names refer to other functions."""
    known = function.func
    again = FunctionType(known.__code__, {**known.__globals__, **names}, f"{known.__name__}_on_cuda")
    again.__annotations__, again.__qualname__, again.__module__ = known.__annotations__, again.__name__, __name__
    return make(again)


_sphere = {"sphere_crossing": _again(crossings.sphere_crossing, noinline)}
_cylinder = {"cylinder_crossing": _again(crossings.cylinder_crossing, **_sphere)}
_round = {
    **_sphere,
    **_cylinder,
    "ellipsoid_crossing": _again(crossings.ellipsoid_crossing, **_sphere),
    "capsule_crossing": _again(crossings.capsule_crossing, **_sphere, **_cylinder),
}
_crossing = {"closed_form_crossing": _again(solids.closed_form_crossing, **_round)}
_meeting = {"meet_closed_form": _again(solids.meet_closed_form, **_crossing)}
triage_closed_form = _again(solids.triage_closed_form, **_meeting)
