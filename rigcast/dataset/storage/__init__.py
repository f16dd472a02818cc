"""Storage of a data set: shards and manifest, in a folder or at a URL."""
