"""Where things stand: shapes for a ray, frames fixed to others, and what moves in between."""
