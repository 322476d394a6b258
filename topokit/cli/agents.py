"""`topokit mcp`: a server of the Model Context Protocol, by which agents ask about shapes in files and mend meshes."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from topokit.batch.examine import report_row
from topokit.errors import InputError, TopokitError, requiring
from topokit.plugins.registry import load

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

    from topokit.shape import Shape

Tool = TypeVar("Tool", bound=Callable[..., Any])

_WRITTEN = (".stl", ".ply", ".obj", ".off", ".glb")
_INSTRUCTIONS = (
    "Topology of 3D shapes in files: meshes, point clouds, volumes and Gaussian splats. Every answer has a verdict: "
    "certain (proven by counting), likely (independent methods agree) or unsure (read the reasons before you act)."
)


def make_server() -> MCPServer:
    """The server with its tools.

    Raises:
        MissingDependencyError: if mcp is not installed.
    """
    with requiring('topokit mcp needs mcp: pip install "topokit[mcp]".'):
        from mcp.server.mcpserver import MCPServer
    from topokit import __version__

    server: MCPServer = MCPServer("topokit", instructions=_INSTRUCTIONS, version=__version__, log_level="WARNING")
    for tool in (report, handles, mend, compare):
        server.tool()(_with_messages(tool))
    return server


def _with_messages(tool: Tool) -> Tool:
    """The tool with errors whose messages reach the client; of any other exception only its own log has the message."""
    from mcp.server.mcpserver.exceptions import ToolError

    @wraps(tool)
    def told(*arguments: Any, **options: Any) -> Any:
        try:
            return tool(*arguments, **options)
        except TopokitError as error:
            raise ToolError(str(error)) from error

    return told  # type: ignore[return-value]


def report(
    path: str, level: float | None = None, label: int | None = None, locate: bool = False, details: bool = False
) -> dict[str, Any]:
    """Euler characteristic, genus, components, tunnels, cavities, closedness and verdict of the shape in a file.

    Args:
        path: of a mesh, point cloud, volume or splat scene.
        level: of a gray volume: the value on the surface.
        label: of a label volume: the voxels with it are the solid.
        locate: also where handles, boundaries and defects are; takes longer.
        details: also estimates from curvature, and the solid that a mesh encloses; takes longer.

    Returns:
        The numbers, all reasons of the verdict, and the report as text.
    """
    shape = _opened(path, level, label)
    found = shape.report(locate=locate, details=details)
    return _numbers(shape, found) | {"reasons": list(found.reasons), "text": found.text(full=True)}


def handles(path: str, level: float | None = None, label: int | None = None, most: int = 300) -> list[dict[str, Any]]:
    """Where the handles and tunnels of a closed shape are, smallest first.

    Args:
        path: as for report.
        level: as for report.
        label: as for report.
        most: a shape with more handles is an error, since locating them takes minutes.

    Returns:
        For each handle the lengths of the loops around it and around its tunnel, its center and its bounding box, in
        coordinates and units of the file.
    """
    from topokit.shape.locate import located_handles

    shape = _opened(path, level, label)
    found = shape.report()
    if (genus := found.genus or 0) > most:
        raise InputError(f"{path} has {genus} handles, more than {most}: pass a larger `most`.")
    names = ("handle_length", "tunnel_length", "center", "bounds")
    located = (one.in_file(found.placement) for one in located_handles(shape.handles()))
    return [{name: getattr(one, name) for name in names} for one in located]


def mend(path: str, output: str, fill: bool = True, below: float | None = None) -> dict[str, Any]:
    """Write a mesh without boundary and without small handles; what is written has been counted.

    Args:
        path: of a mesh.
        output: file to write, which must not exist: .stl, .ply, .obj, .off or .glb.
        fill: whether to close every boundary loop by a fan of triangles.
        below: remove handles and tunnels narrower than this, in units of the file; None keeps all.

    Returns:
        The numbers before and after, and the file.
    """
    target = Path(output)
    if target.suffix.lower() not in _WRITTEN or target.exists() or not target.parent.is_dir():
        raise InputError(f"{output}: a new file called {', '.join(_WRITTEN)} in a folder that exists was expected.")
    before = after = _opened(path)
    if fill and not before.is_closed:
        after = after.fill_boundaries()
    if below is not None:
        after = after.simplify(below=below, cavities=False, components=False)
    after.save(target)
    return {"before": _numbers(before), "after": _numbers(after), "file": str(target)}


def compare(
    path: str, truth: str, level: float | None = None, label: int | None = None, most: int = 20
) -> dict[str, Any]:
    """Which parts, tunnels and cavities of a shape match the truth, which are missing or spurious, and where.

    Args:
        path: of the shape that is judged.
        truth: of the true one: a volume on the same grid, or a closed surface in the same frame.
        level: of two volumes, as for report.
        label: of two volumes, as for report.
        most: places that are given.

    Returns:
        The numbers of both, each of parts, tunnels and cavities, the first places in which they differ, and a text.
    """
    from topokit.pairs.compare import compare as compared  # torch is imported when it is first needed

    found = compared(path, truth, level=level, label=label)
    names = ("error", "kind", "center", "bounds", "width", "length", "volume")
    features = [{name: getattr(one, name) for name in names} for one in found.features[:most]]
    return found.to_dict(places=False) | {"same": found.is_same, "features": features, "text": found.text()}


_NUMBERS = (
    *("verdict", "confidence", "euler", "genus", "components", "pieces", "tunnels", "cavities"),
    *("solid_euler", "boundary_loops", "closed", "manifold"),
)


def _numbers(shape: Shape, found: Any = None) -> dict[str, Any]:
    row = report_row(found or shape.report(), shape)
    return {name: row[name] for name in _NUMBERS}


def _opened(path: str, level: float | None = None, label: int | None = None) -> Shape:
    """The shape in a file. No adapter can be named, so no network, which is a program, is opened for an agent."""
    options: dict[str, Any] = {name: value for name, value in (("level", level), ("label", label)) if value is not None}
    return load(path, **options)
