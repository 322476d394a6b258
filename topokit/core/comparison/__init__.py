"""Two solids on one grid: which of their components, tunnels and cavities are the same, and where they differ."""
