"""Generation of a data set, from the seed of each episode to its shard."""
