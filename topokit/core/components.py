"""What is known about the connected components of a surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import overload

import numpy as np

from topokit.core.arrays import Floats, Integers

Corner = tuple[float, float, float]


def corner(place: Floats) -> Corner:
    """A place (3,) as plain numbers."""
    x, y, z = place.tolist()
    return x, y, z


@dataclass(frozen=True)
class SurfaceComponent:
    """One connected component.

    Attributes:
        euler: its Euler characteristic, or None if there is only an estimate.
        estimate: its Gauss–Bonnet estimate, or None where it was not computed.
        volume: in a volume, that of the voxels next to it on its inner side which are joined to each other: of a
            component without its cavities, or of a cavity without what floats in it. Else None.
        voxel: in a volume, the center of the first voxel on its inner side: one of the piece, or one of the cavity.
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
    volume: float | None = None
    voxel: Corner | None = None


@dataclass(frozen=True, eq=False, repr=False)
class CountedComponents(Sequence[SurfaceComponent]):
    """The components of a counted surface, held as arrays with one row each.

    A sequence of `SurfaceComponent`, each made when it is needed: a million components cost 120 bytes
    each.

    Attributes:
        euler: (C,) Euler characteristics.
        genera: (C,) handles, −1 where a component is not an orientable manifold.
        boundary_loops: (C,) closed boundary curves.
        low, high: (C, 3) corners of the bounding boxes.
        area_shares: (C,) shares of the surface's area.
        inside: (C,) index of the innermost closed component around each, −1 for none.
        depths: (C,) number of closed components around each.
        volumes: (C,) see `SurfaceComponent.volume`, or None.
        voxels: (C, 3) see `SurfaceComponent.voxel`, or None.
    """

    euler: Integers
    genera: Integers
    boundary_loops: Integers
    low: Floats
    high: Floats
    area_shares: Floats
    inside: Integers
    depths: Integers
    volumes: Floats | None = None
    voxels: Floats | None = None

    @classmethod
    def none(cls) -> CountedComponents:
        """The components of an empty surface."""
        numbers, corners = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
        return cls(numbers, numbers, numbers, corners, corners, np.zeros(0), numbers, numbers)

    def rows(self, which: slice) -> CountedComponents:
        """Some of them, as arrays."""
        columns = {one.name: getattr(self, one.name) for one in fields(self)}
        return replace(self, **{name: values[which] for name, values in columns.items() if values is not None})

    @property
    def genus(self) -> int | None:
        """Handles summed over components, or None if any component has no genus."""
        return None if (self.genera < 0).any() else int(self.genera.sum())

    @property
    def cavities(self) -> int:
        """Number of components that bound a hole inside a solid: those at odd depth."""
        return int((self.depths % 2).sum())

    @property
    def solid_betti(self) -> tuple[int, int, int] | None:
        """Betti numbers (components, tunnels, cavities) of the solid that closed components bound.

        Surfaces at even depth are outer walls of the solid, those at odd depth walls of its cavities; a solid has as
        many tunnels as its walls have handles. None if a genus is unknown.
        """
        return None if self.genus is None else (len(self) - self.cavities, self.genus, self.cavities)

    def __len__(self) -> int:
        return len(self.euler)

    @overload
    def __getitem__(self, index: int) -> SurfaceComponent: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[SurfaceComponent, ...]: ...

    def __getitem__(self, index: int | slice) -> SurfaceComponent | tuple[SurfaceComponent, ...]:
        if isinstance(index, slice):
            return tuple(self[row] for row in range(*index.indices(len(self))))
        genus, inside = int(self.genera[index]), int(self.inside[index])
        return SurfaceComponent(
            euler=int(self.euler[index]),
            genus=genus if genus >= 0 else None,
            boundary_loops=int(self.boundary_loops[index]),
            bounds=(tuple(self.low[index].tolist()), tuple(self.high[index].tolist())),
            area_share=float(self.area_shares[index]),
            inside=inside if inside >= 0 else None,
            depth=int(self.depths[index]),
            volume=None if self.volumes is None else float(self.volumes[index]),
            voxel=None if self.voxels is None else tuple(self.voxels[index].tolist()),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence) or len(self) != len(other):
            return False
        return all(mine == theirs for mine, theirs in zip(self, other, strict=True))

    def __hash__(self) -> int:
        return hash(tuple(self))

    def __repr__(self) -> str:
        return f"CountedComponents({len(self)})"
