"""topokit as an accessor of PyVista: `import topokit_pyvista`, then `mesh.topokit.report()`.

It needs PyVista 0.48, the first with accessors.
"""

from __future__ import annotations

import numpy as np
import pyvista

import topokit as tk


@pyvista.register_dataset_accessor("topokit", pyvista.PolyData)
class TopologyAccessor:
    """The topology of a mesh, or of points without faces."""

    def __init__(self, mesh: pyvista.PolyData) -> None:
        self._mesh = mesh

    @property
    def shape(self) -> tk.Shape:
        """The mesh as a `topokit.Shape`, with everything that one can be asked."""
        points_alone = self._mesh.n_strips == 0 and self._mesh.n_faces_strict == 0
        return tk.from_points(self._mesh) if points_alone else tk.from_mesh(self._mesh)

    def report(self, **options: bool) -> tk.TopologyReport:
        """The report; see `topokit.Shape.report`."""
        return self.shape.report(**options)

    def surface(self) -> pyvista.PolyData:
        """The closed surface that the report is about."""
        return pyvista.wrap(self.shape.surface())

    def handles(self) -> pyvista.MultiBlock:
        """The loop around each handle and that around its tunnel, as lines."""
        blocks = pyvista.MultiBlock()
        for number, one in enumerate(self.shape.handles(), 1):
            for kind in ("handle", "tunnel"):
                loop = np.asarray(getattr(one, f"{kind}_loop"))
                blocks.append(pyvista.lines_from_points(loop, close=True), f"{kind} {number}")
        return blocks
