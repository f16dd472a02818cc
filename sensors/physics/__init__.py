"""What sensors do to what their rays hit: effects of light, electronics and weather."""
