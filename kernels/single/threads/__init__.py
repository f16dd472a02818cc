"""Single rays on CUDA, one per thread: a walk over the shapes, and within it one over the triangles of each.

The threads of a warp run in lockstep, so a branch that some of them take costs all of them its time. All rays of a warp
therefore come to the shapes that any of them enters, as long as enough of them do. Within a shape each takes its own
way, and leaves are tested once every thread has reached one. What changes of a ray during traversal is in memory,
because Warp copies a variable at the end of every `if` that changes it. Code is kept short, because threads stall on
instructions that are not in the cache; so hits are completed by another kernel.

Boxes and edges are tested with fused multiply-adds, which round less often than the tests of single rays on the CPU.
So the nodes and triangles that are looked at may differ; the hits do not.
"""
