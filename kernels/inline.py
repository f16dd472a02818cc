"""Decorators that override LLVM's choice whether to inline a function."""

from functools import partial
from inspect import signature

import warp as wp

_CAN_SAY = "inline" in signature(wp.func).parameters

noinline = partial(wp.func, inline=False) if _CAN_SAY else wp.func
"""`wp.func` that is not inlined, if this version of Warp can say so. For functions that are called seldom: LLVM would
inline them into every caller and optimise each copy. Callers copy the structs that they pass."""

inlined = partial(wp.func, inline=True) if _CAN_SAY else wp.func
"""`wp.func` that is always inlined, if this version of Warp can say so. For functions cheaper than a call."""
