"""topokit: what is the topology of this 3D thing, and how far is that to be believed?"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from topokit.adapters.implicit.adapter import from_occupancy, from_sdf
    from topokit.adapters.mesh.adapter import from_mesh
    from topokit.adapters.points.adapter import from_points
    from topokit.adapters.splats.adapter import from_splats
    from topokit.adapters.splats.gaussians import GaussianSplats
    from topokit.adapters.voxels.adapter import from_voxels
    from topokit.core.local.curvature import Curvature
    from topokit.core.samples import SurfaceSamples
    from topokit.errors import TopokitError
    from topokit.losses.euler import EulerLoss, euler_loss
    from topokit.losses.monitor import TopologyMonitor
    from topokit.plugins.adapter import Adapter
    from topokit.plugins.registry import list_adapters, load, refresh_adapters, register_adapter
    from topokit.report.report import Evidence, TopologyReport
    from topokit.shape import Shape

__version__ = "0.1.0"

_HOME = {
    "Adapter": "topokit.plugins.adapter",
    "Curvature": "topokit.core.local.curvature",
    "EulerLoss": "topokit.losses.euler",
    "Evidence": "topokit.report.report",
    "GaussianSplats": "topokit.adapters.splats.gaussians",
    "Shape": "topokit.shape",
    "SurfaceSamples": "topokit.core.samples",
    "TopokitError": "topokit.errors",
    "TopologyMonitor": "topokit.losses.monitor",
    "TopologyReport": "topokit.report.report",
    "euler_loss": "topokit.losses.euler",
    "from_mesh": "topokit.adapters.mesh.adapter",
    "from_occupancy": "topokit.adapters.implicit.adapter",
    "from_points": "topokit.adapters.points.adapter",
    "from_sdf": "topokit.adapters.implicit.adapter",
    "from_splats": "topokit.adapters.splats.adapter",
    "from_voxels": "topokit.adapters.voxels.adapter",
    "list_adapters": "topokit.plugins.registry",
    "load": "topokit.plugins.registry",
    "refresh_adapters": "topokit.plugins.registry",
    "register_adapter": "topokit.plugins.registry",
}

__all__ = [
    "Adapter",
    "Curvature",
    "EulerLoss",
    "Evidence",
    "GaussianSplats",
    "Shape",
    "SurfaceSamples",
    "TopokitError",
    "TopologyMonitor",
    "TopologyReport",
    "euler_loss",
    "from_mesh",
    "from_occupancy",
    "from_points",
    "from_sdf",
    "from_splats",
    "from_voxels",
    "list_adapters",
    "load",
    "refresh_adapters",
    "register_adapter",
]


def __getattr__(name: str) -> object:
    """Public names are imported when they are first used, so that `topokit --help` does not wait for torch."""
    if name not in _HOME:
        raise AttributeError(f"module 'topokit' has no attribute {name!r}; it has {', '.join(__all__)}.")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
