"""Files of finite elements through meshio: the surface of their cells."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.mesh.entry import FINITE_ELEMENTS
from topokit.adapters.mesh.formats.xml import refuse_entities
from topokit.adapters.mesh.polygons import triangles
from topokit.errors import ReadError, requiring
from topokit.inputs.cells import polygons_of_cells
from topokit.inputs.files import head
from topokit.inputs.reading import reading

_VOLUMES = (b"STRUCTURED_POINTS", b"STRUCTURED_GRID", b"RECTILINEAR_GRID")


def read_finite_elements(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) and triangles (F, 3): surface cells as they are; of solid cells the faces that bound the solid.

    Raises:
        ReadError: if the file is malformed.
        MissingDependencyError: without meshio.
    """
    with requiring(f'Reading {path.suffix} needs meshio: pip install "topokit[formats]".'):
        import meshio
    format_name = FINITE_ELEMENTS.get(path.suffix.lower(), "vtu")  # the content of others is XML of VTK
    refuse_entities(path)
    _refuse_other_data(path)
    if format_name == "abaqus":
        _refuse_includes(path)
    damaged = (
        *(meshio.ReadError, ArithmeticError, AssertionError, AttributeError, LookupError),
        *(NotImplementedError, RuntimeError, SyntaxError, TypeError),
    )
    with reading(path, "meshio", *damaged):
        mesh = getattr(meshio, format_name).read(path)  # meshio.read would end the process
    faces = polygons_of_cells((block.type, block.data) for block in mesh.cells)
    points = np.asarray(mesh.points, dtype=np.float64).reshape(len(mesh.points), -1)[:, :3]
    vertices = np.zeros((len(points), 3))
    vertices[:, : points.shape[1]] = points  # of a plane mesh z is 0
    return vertices, triangles(faces)


def _refuse_includes(path: Path) -> None:
    """Refuse an Abaqus file that includes others, which meshio opens wherever they are."""
    with reading(path, "meshio"), path.open() as file:
        for line in file:
            keyword, _, rest = line.partition(",")
            if not line.startswith("**") and keyword.strip().replace("*", "").upper() == "INCLUDE":
                other = rest.rpartition("=")[2].strip()
                raise ReadError(f"{path} includes {other!r}; other files than the given one are not opened.")


def _refuse_other_data(path: Path) -> None:
    """Refuse VTK files of polygons, which meshio does not read, and of volumes, whose cells fill their box."""
    beginning = head(path, 4096)
    found = re.search(rb"^DATASET\s+(\w+)", beginning, re.MULTILINE)
    if b'type="PolyData"' in beginning or (found is not None and found.group(1) == b"POLYDATA"):
        raise ReadError(
            f"{path} holds VTK PolyData, which is not read: open it with PyVista, "
            f"topokit.from_mesh(pyvista.read({path.name!r})), or save it as .ply."
        )
    if found is not None and found.group(1) in _VOLUMES:
        raise ReadError(
            f"{path} holds a volume ({found.group(1).decode()}), which is not read: save it as .nrrd, .nii or .mha, or "
            "pass its values as an array to topokit.from_voxels."
        )
