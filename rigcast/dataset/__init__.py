"""Data sets: a rig in many scenes and episodes, made by any number of workers, one shard for each episode."""
