"""Volumes of any size: each block is counted once by itself, then the counts are joined across the block faces."""
