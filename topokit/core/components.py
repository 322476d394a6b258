"""What is known about one connected component of a surface."""

from __future__ import annotations

from dataclasses import dataclass

Corner = tuple[float, float, float]


@dataclass(frozen=True)
class SurfaceComponent:
    """One connected component.

    Attributes:
        euler: its Euler characteristic, or None if there is only an estimate.
        estimate: its Gauss–Bonnet estimate, or None where it was not computed.
        genus: its handles, (2 − b − χ)/2, or None if it is not an orientable manifold or χ is not known.
        boundary_loops: its closed boundary curves b, or None if they were not counted.
        bounds: lowest and highest corner of its bounding box.
        area_share: its share of the surface's area, 0 … 1.
        inside: index of the innermost closed component around it, or None.
        depth: number of closed components around it, or None if unknown; odd means that it bounds a cavity.
    """

    euler: int | None
    genus: int | None
    boundary_loops: int | None
    bounds: tuple[Corner, Corner]
    area_share: float
    inside: int | None = None
    depth: int | None = None
    estimate: float | None = None
