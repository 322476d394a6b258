"""Topology of predicted segmentations as metrics of evaluation loops."""

from topokit.metrics.topology import TopologyMetric

__all__ = ["TopologyMetric"]
