"""Bounds of a function and of its gradient over boxes, with every rounding error in them."""
