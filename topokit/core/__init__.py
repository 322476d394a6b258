"""The shared differentiable core: torch (and SciPy's KD-tree), no files, no adapters."""
