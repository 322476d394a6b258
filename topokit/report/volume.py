"""The answer of a volume: a count of cells under a stated connectivity."""

from __future__ import annotations

from topokit.core.blocks.whole import CountedVolume
from topokit.core.grid.euler import dual_connectivity
from topokit.core.grid.placement import Placement
from topokit.report.counted import CountedAnswer
from topokit.report.report import Evidence
from topokit.report.verdict import volume_verdict
from topokit.report.wording import plural


def volume_answer(
    counted: CountedVolume, connectivity: int, placement: Placement, seconds: float, notes: tuple[str, ...] = ()
) -> CountedAnswer:
    """The counted answer of a volume.

    Args:
        counted: what was counted.
        connectivity: 6 or 26, that of the solid.
        placement: where the voxels are.
        seconds: time the count took.
        notes: sentences about the values.
    """
    euler, surfaces, dual = counted.euler, counted.surfaces, dual_connectivity(connectivity)
    reasons = [
        f"Exact with {connectivity}-connected foreground and {dual}-connected background: "
        f"{plural(counted.n_inside, 'voxel')} in {plural(len(surfaces) - surfaces.cavities, 'piece')} with "
        f"χ = {euler // 2}, bounded by {plural(len(surfaces), 'closed surface')} with χ = {euler}.",
        *notes,
    ]
    if counted.dual_euler != euler:
        reasons.append(
            f"With {dual}-connected foreground χ of the solid would be {counted.dual_euler // 2} and of its surface "
            f"{counted.dual_euler}: the volume itself is ambiguous."
        )
    touched = _touched_faces(counted)
    if touched:
        reasons.append(
            f"The solid is cut by the volume's border ({', '.join(touched)}) and was closed there, as if there were "
            "background beyond; if it continues in reality, that changes the answer."
        )
    return CountedAnswer(
        evidence=Evidence(f"count of cells, {connectivity}-connected", float(euler), euler, seconds),
        components=surfaces,
        closed=True,
        boundary_loops=0,
        verdict=volume_verdict(),
        reasons=tuple(reasons),
        placement=placement,
    )


def _touched_faces(counted: CountedVolume) -> list[str]:
    return [
        f"{end} layer along axis {axis}"
        for axis, ends in enumerate(counted.touched)
        for end, is_cut in zip(("first", "last"), ends, strict=True)
        if is_cut
    ]
