"""Benchmarks of many worlds at once, as in reinforcement learning, on a GPU if there is one.

`crowd` defines the worlds, `contenders` the casters; `measure` times them in turn, compares their hits with each other
and with mj_ray; `limits` measures the device's peak rates.
"""
