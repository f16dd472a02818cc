"""Effects of lidars: beams, echoes, returns, ranging, weather."""
