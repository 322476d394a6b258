"""What neighboring tools tell about the same twenty files, as a page of the documentation.

python benchmarks/side_by_side.py DATA [docs/comparison.md]     DATA: a folder with index.json, as the tests use it

Needs `pip install pymeshlab open3d gudhi` (pymeshlab is GPL, so in an environment of its own) and the command `admesh`.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gudhi
import numpy as np
import open3d
import pymeshlab
import trimesh

import topokit as tk

WANTED = {"mesh": 10, "bad": 4, "points": 3, "voxels": 3}  # files of each kind, evenly spaced in the index


def main() -> None:
    """Ask every tool about every file and write the page."""
    data = Path(sys.argv[1])
    page = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).parents[1] / "docs" / "comparison.md"
    rows = [row(data, one) for one in chosen(json.loads((data / "index.json").read_text(encoding="utf-8")))]
    page.write_text(text(rows), encoding="utf-8")


def chosen(index: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The files: those with a known answer, evenly spaced."""
    found = []
    for kind, count in WANTED.items():
        known = [one for one in index if one["kind"] == kind and true_euler(one) is not None]
        found += [known[i] for i in np.linspace(0, len(known) - 1, count).round().astype(int)]
    return found


def true_euler(one: dict[str, Any]) -> int | None:
    """χ of the surface: that of a volume's boundary is twice the solid's."""
    if one["kind"] == "voxels":
        return 2 * one["solid_chi_26"] if "solid_chi_26" in one else None
    return one.get("chi")


def row(data: Path, one: dict[str, Any]) -> dict[str, Any]:
    """Every tool's answer about one file."""
    answers = {name: asked(tool, data / one["path"], one["kind"]) for name, tool in TOOLS.items()}
    print(one["path"], true_euler(one), answers, flush=True)
    return {"path": one["path"], "kind": one["kind"], "truth": true_euler(one), "answers": answers}


def asked(tool: Callable[[Path, str], str | None], path: Path, kind: str) -> str:
    """A tool's answer, "–" if it has no function for such files."""
    try:
        return tool(path, kind) or "–"
    except (ValueError, IndexError, TypeError, RuntimeError, OSError, pymeshlab.PyMeshLabException) as error:
        return f"error: {type(error).__name__}"


def with_topokit(path: Path, kind: str) -> str:
    """χ and the verdict."""
    report = tk.load(path).report()
    return f"{report.euler}, {report.verdict}"


def with_trimesh(path: Path, kind: str) -> str | None:
    """χ of the mesh as loaded, with its default merging of vertices."""
    if kind in ("points", "voxels"):
        return None
    mesh = trimesh.load(path, force="mesh")
    return f"{mesh.euler_number}, {'watertight' if mesh.is_watertight else 'not watertight'}"


def with_meshlab(path: Path, kind: str) -> str | None:
    """χ = V − E + F and the genus of the topological measures."""
    if kind in ("points", "voxels"):
        return None
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.load_new_mesh(str(path))
    found = meshes.get_topological_measures()
    euler = found["vertices_number"] - found["unreferenced_vertices"] - found["edges_number"] + found["faces_number"]
    genus = found["genus"] if found["is_mesh_two_manifold"] else "undefined"
    return f"{euler}, genus {genus}, {found['number_holes']} holes"


def with_admesh(path: Path, kind: str) -> str | None:
    """Facets that stay without a neighbor; it reads STL only, so meshes are converted first."""
    if kind in ("points", "voxels"):
        return None
    with tempfile.TemporaryDirectory() as folder:
        stl = Path(folder) / "mesh.stl"
        trimesh.load(path, force="mesh", process=False).export(stl)
        said = subprocess.run(["admesh", "--exact", stl], capture_output=True, text=True, check=True).stdout
    disconnected = re.search(r"Total disconnected facets +: +(\d+)", said)
    return f"{disconnected[1] if disconnected else '?'} open facets, no χ"


def with_open3d(path: Path, kind: str) -> str | None:
    """χ of the mesh; for points, of the screened Poisson surface with normals that it orients itself."""
    if kind == "voxels":
        return None
    if kind != "points":
        mesh = open3d.io.read_triangle_mesh(str(path))
        if path.suffix.lower() == ".stl":
            mesh.remove_duplicated_vertices()
        closed = "watertight" if mesh.is_watertight() else "not watertight"
        return f"{mesh.euler_poincare_characteristic()}, {closed}"
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(tk.load(path).samples.points.double().numpy()))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(20))
    cloud.orient_normals_consistent_tangent_plane(20)
    mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=8)
    return f"{mesh.euler_poincare_characteristic()} of its Poisson surface"


def with_gudhi(path: Path, kind: str) -> str | None:
    """Betti numbers of the simplices of a mesh or the cubes of a volume; for points bars, of which none is chosen."""
    if kind == "points":
        return "bars only"
    if kind == "voxels":
        inside = np.load(path)
        inside = inside[inside.files[0]] > 0
        cubes = gudhi.CubicalComplex(top_dimensional_cells=np.where(inside, 0.0, 1.0))
        cubes.compute_persistence()
        return f"solid {tuple(cubes.persistent_betti_numbers(0.0, 0.5))}"
    mesh = trimesh.load(path, force="mesh", process=True)
    simplices = gudhi.SimplexTree()
    for face in mesh.faces.tolist():
        simplices.insert(face)
    simplices.compute_persistence(persistence_dim_max=True)
    betti = tuple(simplices.betti_numbers())
    return f"{betti[0] - betti[1] + betti[2]}, Betti {betti}"


TOOLS: dict[str, Callable[[Path, str], str | None]] = {
    "topokit": with_topokit,
    "trimesh": with_trimesh,
    "MeshLab": with_meshlab,
    "admesh": with_admesh,
    "Open3D": with_open3d,
    "GUDHI": with_gudhi,
}


def text(rows: list[dict[str, Any]]) -> str:
    """The page."""
    lines = [
        "# Side by side",
        "",
        f"Written by `python benchmarks/side_by_side.py DATA`: what six tools tell about the same {len(rows)} files,",
        "evenly spaced in a collection of real shapes. The second column is the known χ of the surface.",
        "A number at the start of an answer is its χ; **bold** means that it differs from the known one.",
        "Every tool runs with its defaults.",
        "",
        f"| file | χ | {' | '.join(TOOLS)} |",
        f"|---|---|{'---|' * len(TOOLS)}",
    ]
    for one in rows:
        cells = (cell(answer, one["truth"]) for answer in one["answers"].values())
        lines.append(f"| {one['path']} | {one['truth']} | {' | '.join(cells)} |")
    lines += ["", NOTES, ""]
    return "\n".join(lines)


def cell(answer: str, truth: int | None) -> str:
    """An answer, bold where its χ is not the known one."""
    number = re.match(r"-?\d+(?=,| of)", answer)
    return f"**{answer}**" if number and int(number[0]) != truth else answer


NOTES = """\
- **trimesh** merges equal vertices on loading, which some files need and which breaks others, and keeps vertices apart
  whose texture coordinates or normals differ. GUDHI and admesh are given its meshes.
- **MeshLab** has a genus for two-manifold meshes only; χ is computed here from its counts of vertices, edges and
  faces.
- **admesh** connects and repairs STL files. It tells how many facets lack a neighbor, not χ or genus.
- **Open3D** has χ of a mesh as it stands. For points the table shows what its normals and its Poisson surface give.
- **GUDHI** has Betti numbers of whatever complex it is given; for points it returns persistence bars, and the choice
  among them is left to the user.
- None of these says how far its number may be believed."""


if __name__ == "__main__":
    main()
