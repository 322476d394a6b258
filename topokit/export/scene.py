"""What pictures and pages show of a shape: a surface or points with curvature as color, and marks on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from torch import Tensor

from topokit.core.arrays import Floats, Integers
from topokit.core.grid.field import Field
from topokit.core.grid.scaling import at_moderate_size
from topokit.core.local.curvature import Curvature
from topokit.core.removal import Removal
from topokit.export.colors import curvature_of_one, interpolate

if TYPE_CHECKING:
    from topokit.report.location import Location
    from topokit.shape import Shape

MarkKind = Literal["handle", "tunnel", "boundary", "defect", "missing", "spurious"]
MarkForm = Literal["loop", "curve", "dots"]

MOST_MARKS = 300  # of each kind in a scene, in the order of the report; a scan can have thousands
_MOST_POINTS = 400  # dots of one defect

_SMOOTHING = 24  # samples over which the curvature of a vertex is averaged, for a picture without speckles
_LONGEST_EDGE = 0.03  # of the longest side of the box; longer edges are divided while the triangles stay few
_GRID = 192  # cells along the longest side from which a field is shown in steps of several cells


@dataclass(frozen=True, eq=False)
class Mark:
    """A curve or dots on a surface that say where something is.

    Attributes:
        kind: what it marks; decides its color.
        label: what a table calls it.
        points: (M, 3).
        form: "loop" joins the points and the last to the first, "curve" joins them, "dots" does not.
    """

    kind: MarkKind
    label: str
    points: Floats
    form: MarkForm

    @property
    def length(self) -> float:
        """Length of the curve; 0 for dots."""
        if self.form == "dots":
            return 0.0
        ends = np.roll(self.points, -1, axis=0) if self.form == "loop" else self.points[1:]
        return float(np.linalg.norm(ends - self.points[: len(ends)], axis=1).sum())

    @property
    def center(self) -> tuple[float, float, float]:
        """Middle of the bounding box."""
        x, y, z = (self.points.min(axis=0) / 2 + self.points.max(axis=0) / 2).tolist()
        return x, y, z


@dataclass(frozen=True, eq=False)
class Scene:
    """A surface, or points, ready to be drawn.

    Attributes:
        positions: (N, 3), vertices or points.
        normals: (N, 3), unit; of points only, for a surface they follow from the faces.
        values: (N,) what colors show, such as Gaussian curvature; NaN where it is unknown.
        limit: value at which the colors end.
        faces: (F, 3), or None for points.
        legend: what the colors show, and the words for their lower end, middle and upper end.
        marks: what is marked.
        note: how the view differs from the shape, or None.
    """

    positions: Floats
    normals: Floats
    values: Floats
    limit: float
    faces: Integers | None
    legend: tuple[str, str, str, str]
    marks: tuple[Mark, ...] = ()
    note: str | None = None


def marks_of(location: Location | None, most: int | None = MOST_MARKS) -> tuple[Mark, ...]:
    """Handles, tunnels, boundaries and defects in the order of the report; none for None.

    Args:
        location: of a report.
        most: of each kind; then defects have a part of their points, too. None for all.
    """
    if location is None:
        return ()
    marks: list[Mark] = []
    for number, handle in enumerate(location.handles[:most], start=1):
        marks.append(Mark("handle", f"handle {number}: handle loop", handle.handle_loop, "loop"))
        marks.append(Mark("tunnel", f"handle {number}: tunnel loop", handle.tunnel_loop, "loop"))
    for number, boundary in enumerate(location.boundaries[:most], start=1):
        marks.append(Mark("boundary", f"boundary {number}", boundary.points, "loop" if boundary.closed else "curve"))
    for defect in location.defects[:most]:
        step = 1 if most is None else -(-len(defect.points) // _MOST_POINTS)
        marks.append(Mark("defect", defect.kind, defect.points[::step], "dots"))
    return tuple(marks)


def removal_marks(removals: Sequence[Removal]) -> tuple[Mark, ...]:
    """The places where narrow features were removed, narrowest first."""
    return tuple(
        Mark("defect", f"{one.kind} {one.how}, {one.width:.3g} wide", np.array([one.place]), "dots")
        for one in removals[:MOST_MARKS]
    )


def scene_of(shape: Shape, marks: tuple[Mark, ...] = (), *, max_faces: int, max_points: int) -> Scene:
    """The scene of a shape: its mesh, else the level set of its field, else its samples.

    Args:
        shape: any shape that is not batched.
        marks: what to mark on it.
        max_faces: a surface with more triangles is simplified, which the note says.
        max_points: of more points, these many are drawn at random (seed 0).

    Raises:
        InputError: if the samples are batched.
    """
    local = curvature_of_one(shape, "drawn")
    points, values = _numpy(shape.samples.points), _numpy(local.gaussian)
    limit = _color_limit(values)
    found = _mesh(shape)
    if found is None:
        return _points_scene(points, local, values, limit, marks, max_points)
    positions, faces, notes = found
    positions, faces, note = simplified(positions, faces, max_faces)
    positions, faces = _subdivided(positions, faces, max_faces)
    note = " ".join(filter(None, (notes, note))) or None
    shown = interpolate(points, np.clip(values, -limit, limit), positions, _SMOOTHING)
    return Scene(positions, np.zeros((0, 3)), shown, limit, faces, _curvature_legend(limit), marks, note)


def simplified(positions: Floats, faces: Integers, max_faces: int) -> tuple[Floats, Integers, str | None]:
    """A mesh with at most about `max_faces` triangles, by quadric edge collapses, without unused vertices.

    Returns:
        Vertices, faces, and a sentence that says so if the mesh was simplified, else None.
    """
    n_faces, note = len(faces), None
    used, faces = np.unique(faces, return_inverse=True)
    positions, faces = positions[used], faces.reshape(-1, 3).astype(np.int64)
    if n_faces > max_faces:
        import fast_simplification

        center = positions.mean(axis=0)
        kept, triangles = fast_simplification.simplify(
            positions - center, faces.astype(np.int32), target_count=max_faces
        )[:2]
        positions, faces = kept.astype(np.float64) + center, triangles.astype(np.int64)
        note = f"Simplified for this view from {n_faces} to {len(faces)} triangles; counted on all of them."
    return positions, faces, note


def _subdivided(positions: Floats, faces: Integers, max_faces: int) -> tuple[Floats, Integers]:
    """The same surface with shorter edges, so that colors at its vertices can follow the curvature."""
    longest = _LONGEST_EDGE * float(np.ptp(positions, axis=0).max())
    while 4 * len(faces) <= max_faces:
        corners = positions[faces]
        if np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max() <= longest:
            break
        from trimesh.remesh import subdivide

        positions, faces = subdivide(positions, faces)
    return positions, faces


def _points_scene(
    points: Floats, local: Curvature, values: Floats, limit: float, marks: tuple[Mark, ...], max_points: int
) -> Scene:
    """The scene of samples without a surface."""
    normals = _numpy(local.normals)
    shown = interpolate(points, np.clip(values, -limit, limit), points, _SMOOTHING)
    return points_scene(points, normals, shown, limit, _curvature_legend(limit), marks, max_points=max_points)


def points_scene(
    points: Floats,
    normals: Floats,
    values: Floats,
    limit: float,
    legend: tuple[str, str, str, str],
    marks: tuple[Mark, ...] = (),
    *,
    max_points: int,
) -> Scene:
    """The scene of points; of more than `max_points`, so many are drawn at random (seed 0), which the note says."""
    note = None
    if len(points) > max_points:
        note = f"{max_points} of {len(points)} points are shown."
        drawn = np.random.default_rng(0).choice(len(points), max_points, replace=False)
        points, normals, values = points[drawn], normals[drawn], values[drawn]
    return Scene(points, normals, values, limit, None, legend, marks, note)


def _mesh(shape: Shape) -> tuple[Floats, Integers, str | None] | None:
    """Vertices and faces of the mesh or of the field's level set, with a note; None if there is neither."""
    if shape.mesh is not None:
        return _numpy(shape.mesh[0]), shape.mesh[1].cpu().numpy(), None
    return None if shape.field is None else _level_set(shape.field)


def view_step(shape: Sequence[int]) -> int:
    """Steps of a grid (X, Y, Z) that a view takes at once: one, but two or more of a large one."""
    return -(-max(shape) // _GRID)


def _level_set(field: Field) -> tuple[Floats, Integers, str | None] | None:
    """The level set of a field as a mesh, closed where the grid ends; large fields lose every second vertex or more."""
    from skimage.measure import marching_cubes

    step = view_step(field.grid.shape)
    thinned = field.detached()[::step, ::step, ::step].cpu().double()
    values = at_moderate_size(thinned.nan_to_num()).float().numpy()
    padded = np.pad(values, 1, constant_values=min(-1e-6, float(values.min())))
    if not (padded > 0).any():
        return None
    vertices, faces, _, _ = marching_cubes(padded, 0.0)
    grid = field.grid
    positions = np.asarray(grid.origin) + (vertices - 1) * step * np.asarray(grid.spacing)
    note = f"Every {step}th grid point is shown." if step > 1 else None
    return positions, faces[:, ::-1].astype(np.int64), note


def _color_limit(values: Floats) -> float:
    """95th percentile of the absolute value, so that single peaks do not wash out the rest; 1 for a flat surface."""
    return float(np.quantile(np.abs(values), 0.95)) or 1.0


def _curvature_legend(limit: float) -> tuple[str, str, str, str]:
    end = f"{float(f'{limit:.2g}'):g}"
    return "Gaussian curvature", f"−{end}", "0", end


def _numpy(tensor: Tensor) -> Floats:
    return np.nan_to_num(tensor.detach().cpu().double().numpy())
