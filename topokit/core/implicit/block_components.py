"""The closed surfaces of a field on a grid that is evaluated box by box, and joined exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topokit.core.blocks.division import Box, Division
from topokit.core.blocks.on_dask import reduced
from topokit.core.blocks.part import Part, count_box, join_parts
from topokit.core.blocks.whole import counted_volume
from topokit.core.components import CountedComponents
from topokit.core.implicit.adaptive_grid import refine_in_box
from topokit.core.implicit.blockwise import Blocks, Refinements


def components_in_blocks(known: Refinements, connectivity: int, blocks: Blocks) -> CountedComponents:
    """The connected closed surfaces of {F > 0} on the finest known grid.

    Args:
        known: of the field's grids.
        connectivity: 6 or 26, that of the solid.
        blocks: how to divide the grid.
    """
    division = Division.even(known.grid.shape, blocks.most_vertices)
    count = _PartOfBox(known, connectivity)
    whole = reduced(division, lambda box: None, count, join_parts, blocks.client, Part.without_faces)
    return counted_volume(whole, connectivity, known.grid).surfaces


@dataclass(frozen=True, eq=False)
class _PartOfBox:
    """Counts the regions of a box; it is sent to workers."""

    known: Refinements
    connectivity: int

    def __call__(self, _: None, box: Box) -> Part:
        refined = refine_in_box(self.known.base, box, self.known.evaluate, self.known.followed)
        if isinstance(refined, bool):
            inside = np.full([stop - start for start, stop in box], refined)
        else:
            inside = (refined.field.values > 0).numpy()
        return count_box(inside, box, self.known.grid.shape, self.connectivity)
