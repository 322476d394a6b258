from . import export, losses, metrics, pages, testing
from .adapters.implicit.adapter import from_occupancy, from_sdf
from .adapters.mesh.adapter import from_mesh
from .adapters.points.adapter import from_points
from .adapters.splats.adapter import from_splats
from .adapters.splats.gaussians import GaussianSplats
from .adapters.voxels.adapter import from_voxels
from .adapters.voxels.labels import from_labels
from .batch.distribution import SurveySummary, TopologyDistance
from .batch.survey import Survey, survey
from .comparison.result import Comparison
from .core.components import SurfaceComponent
from .core.handles.handle import Handle
from .core.local.curvature import Curvature, CurvatureSettings
from .core.loops import BoundaryLoop
from .core.mesh.defects import Defect
from .core.mesh.solid_by_winding import EnclosedSolid
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
from .pairs.blocks import compare_blocks
from .pairs.compare import compare, compare_labels
from .plugins.adapter import Adapter
from .plugins.registry import list_adapters, load, refresh_adapters, register_adapter
from .questions import euler, genus, report
from .repair.enforce import enforce
from .report.counted import CountedAnswer
from .report.location import Location
from .report.report import Evidence, TopologyReport
from .shape import Shape

__version__: str
__all__ = [
    "Adapter",
    "AdapterError",
    "AdapterWarning",
    "BoundaryLoop",
    "Comparison",
    "CountedAnswer",
    "Curvature",
    "CurvatureSettings",
    "Defect",
    "EnclosedSolid",
    "EulerLoss",
    "Evidence",
    "GaussianSplats",
    "GenusError",
    "Handle",
    "InputError",
    "Location",
    "MissingDependencyError",
    "ReadError",
    "Shape",
    "SurfaceComponent",
    "SurfaceSamples",
    "Survey",
    "SurveySummary",
    "TopokitError",
    "TopologyDistance",
    "TopologyLoss",
    "TopologyMonitor",
    "TopologyReport",
    "UnknownFormatError",
    "compare",
    "compare_blocks",
    "compare_labels",
    "enforce",
    "euler",
    "euler_loss",
    "export",
    "from_labels",
    "from_mesh",
    "from_occupancy",
    "from_points",
    "from_sdf",
    "from_splats",
    "from_voxels",
    "genus",
    "list_adapters",
    "load",
    "losses",
    "metrics",
    "pages",
    "refresh_adapters",
    "register_adapter",
    "report",
    "survey",
    "testing",
    "topology_loss",
]
