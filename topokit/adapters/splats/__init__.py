"""Gaussian splats: one reader per format, cleaning, and samples on the discs. Nothing is imported before its use."""
