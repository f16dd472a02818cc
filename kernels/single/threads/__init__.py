"""Single rays on CUDA, one per thread: both levels of the geometry are traversed in one loop and with one stack.

The threads of a warp run in lockstep, so a branch that some of them take costs all of them its time. Nodes of both
levels are therefore traversed by the same code until every thread has reached a leaf; then blocks and patches are
tested, then shapes. What changes of a ray during traversal is in memory, because Warp copies a variable at the end of
every `if` that changes it. Code is kept short, because threads stall on instructions that are not in the cache.

Boxes and edges are tested with fused multiply-adds, which round less often than the tests of single rays on the CPU.
So the nodes and triangles that are looked at may differ; the hits do not.
"""
