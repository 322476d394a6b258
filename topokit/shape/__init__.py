"""`Shape`: what every adapter returns and what users ask."""

from topokit.shape.shape import UNNAMED, Shape

__all__ = ["UNNAMED", "Shape"]
