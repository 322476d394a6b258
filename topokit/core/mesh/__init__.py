"""Triangle meshes: combinatorial topology, sampling, winding numbers."""
