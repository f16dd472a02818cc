"""Rays on CUDA, each in a thread, through both levels of the geometry in one loop and with one stack.

The threads of a warp wait for each other, and what some of them do alone takes all of them as long. So nodes of either
level are walked in one place, until every thread has a leaf; then come those with triangles, and those with a shape.
What a ray changes on its way is in memory, as Warp copies variables at the end of every `if` that changes them, and
code is short, as threads wait for instructions that are not in the cache.

Boxes and edges are judged by fused products, with fewer roundings than single rays on the CPU have: what is looked at
may differ, and the hits do not.
"""
