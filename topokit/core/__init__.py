"""Numerical core: torch where results are differentiable, NumPy and SciPy elsewhere. Returns numbers."""
