"""Functions that stay functions: LLVM would put them into each of their callers, and optimise them anew there."""

from functools import partial
from inspect import signature

import warp as wp

noinline = partial(wp.func, inline=False) if "inline" in signature(wp.func).parameters else wp.func
"""As `wp.func`, where Warp can say so. Callers copy the structs that they hand over: for what is seldom called."""
