"""Shapes written to files and converted to other libraries."""
