"""Where a data set lies: its shards, its manifest, in a folder or at a URL."""
