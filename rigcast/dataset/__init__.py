"""Data sets: a rig in many scenes and episodes, made by any number of workers, one shard for each episode.

The file of a data set is read into a `description`; `making` takes that to the shards and the manifest of `storage`;
`reading` gives frames back from there.
"""
