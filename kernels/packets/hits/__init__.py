"""Where the rays of packets hit, and the way of that to the caller."""
