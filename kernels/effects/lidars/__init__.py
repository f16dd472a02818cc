"""What lidars make of hits: beams, echoes and returns, ranges, weather."""
