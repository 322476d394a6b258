"""One handle of a surface: where it is, how large, and the mesh without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from topokit.core.arrays import Floats, Integers
from topokit.core.components import Corner, corner
from topokit.core.handles.surgery import Arrays, without_loops

Made = TypeVar("Made")


@dataclass(frozen=True, eq=False)
class Handle(Generic[Made]):
    """One handle of a closed surface, as two closed curves that cross each other.

    Attributes:
        handle_loop: (N, 3) corners of the curve that bounds inside the solid: it runs around the handle. The first is
            not repeated.
        tunnel_loop: (M, 3) corners of the curve that bounds outside: it runs around the tunnel.
        handle_length: of `handle_loop`, in units of the vertices.
        tunnel_length: of `tunnel_loop`.
        bounds: lowest and highest corner of the box around both.
        component: index into the report's `per_component`.
        handle_vertices: (n,) vertices of the surface in order along its edges, close to `handle_loop`: where it is cut.
        tunnel_vertices: (m,) the same close to `tunnel_loop`.
    """

    handle_loop: Floats
    tunnel_loop: Floats
    handle_length: float
    tunnel_length: float
    bounds: tuple[Corner, Corner]
    component: int
    handle_vertices: Integers
    tunnel_vertices: Integers
    _mesh: Arrays = field(repr=False)
    _made: Callable[[Floats, Integers], Made] = field(repr=False)

    @property
    def size(self) -> float:
        """Length of the shorter curve."""
        return min(self.handle_length, self.tunnel_length)

    @property
    def center(self) -> Corner:
        """Middle of the box around `tunnel_loop`: a place in the tunnel, on its axis where that is straight."""
        low, high = self.tunnel_loop.min(axis=0), self.tunnel_loop.max(axis=0)
        return corner((low + high) / 2)

    @property
    def shorter(self) -> Integers:
        """Vertices along edges close to the shorter curve."""
        return self.handle_vertices if self.handle_length <= self.tunnel_length else self.tunnel_vertices

    def __repr__(self) -> str:
        return (
            f"Handle(handle_length={self.handle_length:.4g}, tunnel_length={self.tunnel_length:.4g}, "
            f"bounds={self.bounds}, component={self.component})"
        )

    def cut(self) -> Made:
        """The shape whose surface is cut through along the handle loop, with both ends closed: one handle less.

        The cut follows the edges nearest to the loop. Its vertices are doubled and draw back a little to their sides;
        no other vertex moves, and the order of vertices and faces is kept.

        Raises:
            InputError: if the mesh is too coarse for the loop.
        """
        return self._without(self.handle_vertices)

    def fill(self) -> Made:
        """The shape whose tunnel is closed by a wall at the tunnel loop: one handle less; otherwise as `cut`.

        Raises:
            InputError: if the mesh is too coarse for the loop.
        """
        return self._without(self.tunnel_vertices)

    def _without(self, loop: Integers) -> Made:
        return self._made(*without_loops(*self._mesh, [loop]))
