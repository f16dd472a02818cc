"""How fast rigcast is, measured beside other ray casters on the same rays in the same run.

`workloads` says what is cast, `casters` who casts it, `race` times them in turns and holds their hits to mj_ray's;
`casting`, `preparing` and `stepping` are measurements of rigcast alone, `scaling` how its speed changes with size,
`worlds` many worlds at once; `report` writes and draws what was found.
"""
