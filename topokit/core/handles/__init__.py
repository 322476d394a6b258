"""Handles of closed surfaces: cycle bases, the side on which loops bound, short and small loops, cutting, capping."""
