"""Launches of kernels: in slices over CPU threads, in turns that threads claim, with arguments packed once."""
