"""How fast rigcast is, measured beside other ray casters on the same rays in the same run.

`workloads` says what is cast, `casters` who casts it, `race` times them in turns and holds their hits to mj_ray's;
`figures` are measurements of rigcast alone, `scaling` how its speed changes with size, `charts` draws both.
"""
