from . import losses, testing
from .adapters.implicit.adapter import from_occupancy, from_sdf
from .adapters.mesh.adapter import from_mesh
from .adapters.points.adapter import from_points
from .adapters.splats.adapter import from_splats
from .adapters.splats.gaussians import GaussianSplats
from .adapters.voxels.adapter import from_voxels
from .adapters.voxels.labels import from_labels
from .batch.survey import survey
from .core.handles.handle import Handle
from .core.local.curvature import Curvature
from .core.samples import SurfaceSamples
from .errors import (
    AdapterError,
    AdapterWarning,
    GenusError,
    InputError,
    MissingDependencyError,
    ReadError,
    TopokitError,
    UnknownFormatError,
)
from .losses.euler import EulerLoss, euler_loss
from .losses.monitor import TopologyMonitor
from .losses.topology import TopologyLoss, topology_loss
from .plugins.adapter import Adapter
from .plugins.registry import list_adapters, load, refresh_adapters, register_adapter
from .repair import fill_boundaries, simplify_topology
from .report.report import CountedAnswer, Evidence, TopologyReport
from .shape import Shape

__version__: str
__all__ = [
    "Adapter",
    "AdapterError",
    "AdapterWarning",
    "CountedAnswer",
    "Curvature",
    "EulerLoss",
    "Evidence",
    "GaussianSplats",
    "GenusError",
    "Handle",
    "InputError",
    "MissingDependencyError",
    "ReadError",
    "Shape",
    "SurfaceSamples",
    "TopokitError",
    "TopologyLoss",
    "TopologyMonitor",
    "TopologyReport",
    "UnknownFormatError",
    "euler_loss",
    "fill_boundaries",
    "from_labels",
    "from_mesh",
    "from_occupancy",
    "from_points",
    "from_sdf",
    "from_splats",
    "from_voxels",
    "list_adapters",
    "load",
    "losses",
    "refresh_adapters",
    "register_adapter",
    "simplify_topology",
    "survey",
    "testing",
    "topology_loss",
]
