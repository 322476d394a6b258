"""Exact nearest neighbors, on the CPU and on accelerators."""

from topokit.core.neighbors.search import first_neighbors, merged_neighbors, nearest_neighbors, neighbor_components

__all__ = ["first_neighbors", "merged_neighbors", "nearest_neighbors", "neighbor_components"]
