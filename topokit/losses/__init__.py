"""Losses that ask for a topology, and what goes with them in a training loop."""

from topokit.losses.critical import CriticalPoints, critical_points
from topokit.losses.euler import EulerLoss, euler_loss
from topokit.losses.monitor import TopologyMonitor, TopologyRecord
from topokit.losses.schedule import TauSchedule

__all__ = [
    "CriticalPoints",
    "EulerLoss",
    "TauSchedule",
    "TopologyMonitor",
    "TopologyRecord",
    "critical_points",
    "euler_loss",
]
