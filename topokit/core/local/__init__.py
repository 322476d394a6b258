"""Differential geometry of samples: frames, Voronoi areas, the Weingarten map, curvature, Gauss–Bonnet."""
