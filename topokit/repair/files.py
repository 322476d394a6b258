"""Shapes written to files: meshes through trimesh, volumes in the formats that hold their values and voxel sizes."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from topokit.adapters.voxels.field import VoxelField
from topokit.adapters.voxels.writing import WRITERS, write_volume
from topokit.core.grid.placement import Placement
from topokit.errors import InputError
from topokit.inputs.writing import completed_file
from topokit.shape import Shape

MESHES = (".stl", ".ply", ".obj", ".off", ".glb")
"""Formats of meshes that are written."""


def save(shape: Shape, path: str | os.PathLike[str]) -> None:
    """Write a mesh or a volume; see `Shape.save`."""
    target = _in_folder(path)
    if shape.mesh is not None:
        suffix = _suffix(target, MESHES, f"{shape.name} is a mesh")
        with completed_file(target) as unfinished:
            shape.to_trimesh().export(unfinished, file_type=suffix[1:])
    elif isinstance(shape.field, VoxelField):
        suffix = _suffix(target, tuple(WRITERS), f"{shape.name} is a volume")
        values = shape.field.volume.detach().cpu().to(shape.field.given_type).numpy()
        with completed_file(target) as unfinished:
            write_volume(unfinished, suffix, values, _placement(shape.field))
    else:
        raise InputError(
            f"{shape.name} is neither a mesh nor a volume in memory. Write shape.surface() by its export(path), or "
            "samples by save_ply."
        )


def save_surface(shape: Shape, path: str | os.PathLike[str]) -> tuple[int, int]:
    """Write the surface of a shape as a mesh, in the coordinates of the shape's file.

    Args:
        shape: with a surface; see `Shape.surface`.
        path: file to write, called .stl, .ply, .obj, .off or .glb.

    Returns:
        Numbers of its vertices and faces.

    Raises:
        InputError: if there is no surface, the file is called otherwise or its folder does not exist.
    """
    target = _in_folder(path)
    suffix = _suffix(target, MESHES, "a surface is a mesh")
    mesh, placement = shape.surface(), shape.report().placement
    if placement is not None:
        mesh.vertices = placement.in_file(mesh.vertices)
        if placement.is_mirrored:
            mesh.invert()
    with completed_file(target) as unfinished:
        mesh.export(unfinished, file_type=suffix[1:])
    return len(mesh.vertices), len(mesh.faces)


def _in_folder(path: str | os.PathLike[str]) -> Path:
    target = Path(path)
    if not target.parent.is_dir():
        raise InputError(f"{target}: the folder {target.parent} does not exist.")
    return target


def _suffix(path: Path, known: tuple[str, ...], what: str) -> str:
    name = path.name.lower()
    found = max((suffix for suffix in known if name.endswith(suffix)), key=len, default=None)
    if found is None:
        raise InputError(f"{what}, which is written as {', '.join(known)}; {path.name!r} is none of these.")
    return found


def _placement(field: VoxelField) -> Placement:
    """Where the voxels of a field are, which may be a box of a larger volume."""
    whole = field.placement
    if whole.affine is None:
        return whole
    affine = np.asarray(whole.affine)
    affine[:3, 3] += affine[:3, :3] @ whole.voxel(field.grid.origin)
    return Placement(whole.spacing, field.grid.origin, tuple(map(tuple, affine.tolist())), whole.unit, whole.space)
