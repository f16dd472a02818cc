"""What LLVM makes of calls, where its own choice is a bad one."""

from functools import partial
from inspect import signature

import warp as wp

_CAN_SAY = "inline" in signature(wp.func).parameters

noinline = partial(wp.func, inline=False) if _CAN_SAY else wp.func
"""As `wp.func`, where Warp can say so: stays a function, which LLVM would put into each of its callers, and optimise
anew there. Callers copy the structs that they hand over: for what is seldom called."""

inlined = partial(wp.func, inline=True) if _CAN_SAY else wp.func
"""As `wp.func`, where Warp can say so: goes into its callers, for what takes less time than to hand it over."""
