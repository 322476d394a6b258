"""The answer of a volume: a count of cells under a stated connectivity."""

from __future__ import annotations

from torch import Tensor

from topokit.core.components import CountedComponents
from topokit.core.grid.euler import dual_connectivity
from topokit.report.report import CountedAnswer, Evidence
from topokit.report.verdict import volume_verdict
from topokit.report.wording import plural


def volume_answer(
    inside: Tensor,
    components: CountedComponents,
    connectivity: int,
    euler: int,
    other_euler: int,
    seconds: float,
) -> CountedAnswer:
    """The counted answer of a volume.

    Args:
        inside: (X, Y, Z) bool, the solid.
        components: its closed surfaces.
        connectivity: 6 or 26, that of the solid.
        euler: χ of the surface with that connectivity.
        other_euler: χ of the surface with the other connectivity.
        seconds: time the count took.
    """
    dual = dual_connectivity(connectivity)
    reasons = [
        f"χ = {euler} is exact with {connectivity}-connected foreground and {dual}-connected background: "
        f"{int(inside.sum())} voxels in {plural(len(components) - components.cavities, 'component')}, bounded by "
        f"{plural(len(components), 'closed surface')}."
    ]
    if other_euler != euler:
        reasons.append(f"With {dual}-connected foreground χ would be {other_euler}: the volume itself is ambiguous.")
    touched = _touched_faces(inside)
    if touched:
        reasons.append(
            f"The solid is cut by the volume's border ({', '.join(touched)}) and was closed there, as if there were "
            "background beyond; if it continues in reality, that changes the answer."
        )
    return CountedAnswer(
        evidence=Evidence(f"count of cells, {connectivity}-connected", float(euler), euler, seconds),
        components=components,
        closed=True,
        boundary_loops=0,
        verdict=volume_verdict(),
        reasons=tuple(reasons),
    )


def _touched_faces(inside: Tensor) -> list[str]:
    return [
        f"{'first' if end == 0 else 'last'} layer along axis {axis}"
        for axis in range(3)
        for end in (0, -1)
        if bool(inside.select(axis, end).any())
    ]
