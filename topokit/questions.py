"""Questions to a file or an object in one call: `topokit.report("part.stl")`, `topokit.euler`, `topokit.genus`."""

from __future__ import annotations

from typing import Any

from topokit.plugins.registry import load
from topokit.report.report import TopologyReport, known_euler
from topokit.shape import Shape


def report(
    source: Any,
    *,
    details: bool = False,
    locate: bool = False,
    features: bool | float = False,
    certify: bool | None = None,
    **options: Any,
) -> TopologyReport:
    """The report of a file or an object: `topokit.load(source, **options).report()`.

    Args:
        source: a `Shape`, or whatever `topokit.load` opens, such as a pair (vertices, faces). Other arrays go to the
            function of their kind first: `topokit.from_points(points).report()`.
        details: as for `Shape.report`.
        locate: as for `Shape.report`.
        features: as for `Shape.report`.
        certify: as for `Shape.report`.
        options: as for `topokit.load`.

    Raises:
        TopokitError: whatever `topokit.load` and `Shape.report` raise.

    Example:
        >>> import topokit as tk
        >>> import trimesh
        >>> tk.report(trimesh.creation.torus(1, 0.4)).genus
        1
    """
    return _shape(source, options).report(details=details, locate=locate, features=features, certify=certify)


def euler(source: Any, **options: Any) -> int:
    """The Euler characteristic of a file or an object: `report(source).euler`, an integer without a gradient.

    Args:
        source: as for `report`.
        options: as for `topokit.load`.

    Raises:
        InputError: if it is unknown.
        TopokitError: whatever `topokit.load` raises.
    """
    return known_euler(_shape(source, options).report())


def genus(source: Any, **options: Any) -> int:
    """The genus of a file or an object, summed over components.

    Args:
        source: as for `report`.
        options: as for `topokit.load`.

    Raises:
        GenusError: if it is undefined or unknown; the message names the call that says more.
        TopokitError: whatever `topokit.load` raises.
    """
    return _shape(source, options).genus()


def _shape(source: Any, options: dict[str, Any]) -> Shape:
    return source if isinstance(source, Shape) and not options else load(source, **options)
