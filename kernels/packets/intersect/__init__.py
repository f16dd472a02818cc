"""What packets are held against: boxes, edges and planes of triangles, solids."""
