"""Where a ray meets a triangle or a closed form."""
