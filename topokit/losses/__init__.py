"""Losses on topology, and what a training loop needs beside them: monitor, critical points."""

from topokit.core.local.descent import integrity_well
from topokit.losses.critical import CriticalPoints, critical_points
from topokit.losses.euler import EulerLoss, euler_loss
from topokit.losses.field_loss import CountedSolid, FieldLoss
from topokit.losses.monitor import TopologyMonitor, TopologyRecord
from topokit.losses.segmentation import SegmentationTopologyLoss
from topokit.losses.topology import TopologyLoss, topology_loss
from topokit.losses.winding import WindingLoss, winding_loss

__all__ = [
    "CountedSolid",
    "CriticalPoints",
    "EulerLoss",
    "FieldLoss",
    "SegmentationTopologyLoss",
    "TopologyLoss",
    "TopologyMonitor",
    "TopologyRecord",
    "WindingLoss",
    "critical_points",
    "euler_loss",
    "integrity_well",
    "topology_loss",
    "winding_loss",
]
