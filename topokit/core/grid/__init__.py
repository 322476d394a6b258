"""Fields on regular grids: Euler characteristic, components, B-splines, the winding-number field."""
