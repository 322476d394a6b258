"""Signed distance and occupancy networks, and other functions."""
