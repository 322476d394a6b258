"""Proofs of the topology of level sets: an octree of bounded cells, a triangulation of it, and the theorem's test."""
