"""Repair that is counted before it is returned: shapes without narrow features, and volumes of given Betti numbers."""
