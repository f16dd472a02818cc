"""What there is to know about a hit, and its way out of a kernel."""
