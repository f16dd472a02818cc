"""What comes from the host at every step, on its way into the arrays of a device."""
