"""Gaussian splats: one reader per format, cleaning, and samples on the discs."""

from topokit.adapters.splats.adapter import from_splats
from topokit.adapters.splats.gaussians import GaussianSplats

__all__ = ["GaussianSplats", "from_splats"]
