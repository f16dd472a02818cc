"""Data sets: readings of a rig in many scenes and episodes, made by any number of workers, one shard per episode.

The file of a data set is read into a `description`; `making` turns it into the shards and manifest of `storage`;
`reading` reads frames from there.
"""
