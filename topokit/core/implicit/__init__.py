"""Level sets of functions: adaptive grids, projection, convergence of the Euler characteristic."""
