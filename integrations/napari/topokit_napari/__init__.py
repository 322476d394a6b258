"""topokit in napari: a reader of shapes, and a widget that finds the tunnels of a label.

Layers hold the report under the key "report" of their metadata. All coordinates are those of topokit: the index of a
voxel times its size, and the origin added.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import topokit as tk

if TYPE_CHECKING:
    import napari.layers
    import napari.types

    LayerData = tuple[Any, dict[str, Any], str]

COLORS = {"handle": "orange", "tunnel": "limegreen"}


def get_reader(path: str | list[str]) -> Callable[[str], list[LayerData]] | None:
    """What reads a path; None for several paths, which napari then offers one by one."""
    return read if isinstance(path, str) else None


def read(path: str) -> list[LayerData]:
    """The layers of a file: its surface, volume or points, and the loops of its handles and tunnels if it has any."""
    shape = tk.load(path)
    report = shape.report(locate=True)
    about = {"name": shape.name, "metadata": {"report": report.to_dict(), "text": str(report)}}
    return [_body(shape, about), *_loops(report)]


def tunnels(layer: napari.layers.Labels, label: int = 1) -> list[napari.types.LayerDataTuple]:
    """The loops around handles and tunnels of a label, in a layer whose name is the answer."""
    report = tk.from_voxels(layer.data, label=label, spacing=tuple(layer.scale)).report(locate=True)
    name = f"label {label}: pieces {report.pieces}, tunnels {report.tunnels}, cavities {report.cavities}"
    found = _loops(report) or [([], {}, "shapes")]
    return [(data, more | {"name": name, "translate": layer.translate}, kind) for data, more, kind in found]


def _body(shape: tk.Shape, about: dict[str, Any]) -> LayerData:
    if shape.mesh is not None:
        return tuple(part.numpy() for part in shape.mesh), about, "surface"
    if shape.field is not None:
        values, level = shape.field.gray_values()
        grid = {"scale": shape.field.grid.spacing, "translate": shape.field.grid.origin}
        return values.numpy(), about | grid | {"metadata": about["metadata"] | {"level": level}}, "image"
    return shape.samples.points.numpy(), about | {"size": 1}, "points"


def _loops(report: tk.TopologyReport) -> list[LayerData]:
    """One layer of closed curves: around each handle, and around its tunnel."""
    handles = report.location.handles if report.location is not None else ()
    if not handles:
        return []
    pairs = [(kind, getattr(one, f"{kind}_loop")) for one in handles for kind in COLORS]
    colors = [COLORS[kind] for kind, _ in pairs]
    about = {"name": f"{len(handles)} handles", "metadata": {"report": report.to_dict()}}
    shown = {"shape_type": "polygon", "edge_color": colors, "face_color": "transparent", "edge_width": 0.5}
    return [([loop for _, loop in pairs], about | shown, "shapes")]
