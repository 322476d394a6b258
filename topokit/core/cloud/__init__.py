"""Global topology of point samples: orientation, minimum cuts of Delaunay tetrahedra, votes."""
