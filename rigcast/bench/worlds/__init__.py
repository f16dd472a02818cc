"""Many worlds cast at once, as reinforcement learning has them: on a GPU where there is one.

`crowd` says what is cast, `contenders` who casts it, `measure` times them in turns and holds their hits to each other's
and mj_ray's, `limits` is what the device could do at most.
"""
