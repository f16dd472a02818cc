"""Single rays through the trees, each with its own stack: CUDA, and rays on the CPU that do not fill packets."""
