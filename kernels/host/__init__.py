"""Transfer of data from the host at every step into arrays of a device."""
