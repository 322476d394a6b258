"""Handles of closed surfaces: cycle bases, the side on which loops bound, short loops, cutting and capping."""
