"""The rays of a sensor: where they begin, which way they go, and when each was fired."""
