"""Benchmarks of rigcast, interleaved with other ray casters on the same rays in the same run.

`workloads` defines scenes and rays, `casters` the ray casters; `race` times them in turn and compares hits with mj_ray;
`casting`, `preparing` and `stepping` are measurements of rigcast alone, `scaling` how its speed changes with size,
`worlds` measures many worlds at once; `report` writes and draws the results.
"""
