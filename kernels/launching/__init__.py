"""How kernels are launched: in slices over threads, by turns, with arguments packed once."""
