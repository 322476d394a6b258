"""Handles of a bar with ten holes against MeshLib's tunnel loops: time, memory and length of the loops, in one run.

    python benchmarks/handles.py          # 10 000, 100 000 and 1 000 000 triangles
    python benchmarks/handles.py DATA     # also cuts and fills every handle of the clean meshes in a collection

Limit: at most 60 s and 6 GiB for a million triangles. MeshLib (`pip install meshlib`, free for evaluation and
non-commercial use only) is compared where it is installed: its basis of loops along edges, which does not tell handles
from tunnels and is not shortened. topokit's is both. Every measurement is a process of its own; times are CPU seconds
without reading the mesh.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from time import process_time

import numpy as np
import trimesh

import topokit as tk
from topokit.core.handles.find import find_handles
from topokit.core.handles.surgery import without_loops
from topokit.core.mesh.topology import mesh_topology
from topokit.testing import genus_mesh

GENUS = 10
SIZES = {10_000: (14, 0), 100_000: (43, 0), 1_000_000: (68, 1)}  # triangles: cells across a ring, subdivisions
MOST_SECONDS, MOST_GIB = 60.0, 6.0


def lengths_by_topokit(vertices: np.ndarray, faces: np.ndarray) -> tuple[list[float], list[float]]:
    handles = find_handles(vertices, mesh_topology(vertices, faces), lambda *mesh: mesh)
    return [handle.handle_length for handle in handles], [handle.tunnel_length for handle in handles]


def lengths_by_meshlib(vertices: np.ndarray, faces: np.ndarray) -> tuple[list[float], list[float]]:
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(faces.astype(np.int32), vertices.astype(np.float32))
    loops = mrmeshpy.detectBasisTunnels(mesh, mrmeshpy.edgeLengthMetric(mesh))
    return [sum(mesh.edgeLength(edge.undirected()) for edge in loop) for loop in loops], []


def measured(path: Path, name: str) -> dict:
    """Time and memory of one method in this process."""
    arrays = np.load(path)
    vertices, faces = arrays["vertices"], arrays["faces"]
    method = {"topokit": lengths_by_topokit, "meshlib": lengths_by_meshlib}[name]
    started = process_time()
    lengths = method(vertices, faces)
    seconds = process_time() - started
    peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return {"seconds": seconds, "gib": int(peak.split()[1]) / 2**20, "lengths": lengths}


def in_a_process(path: Path, name: str) -> dict | None:
    """The same in a process of its own; None if the method is not installed."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "TBB_NUM_THREADS": "1"}
    command = [sys.executable, __file__, "--measure", str(path), name]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if name == "meshlib" and "No module named 'meshlib'" in done.stderr:
        return None
    done.check_returncode()
    return json.loads(done.stdout)


def compare(folder: Path) -> None:
    for size, (resolution, subdivisions) in SIZES.items():
        vertices, faces = genus_mesh(GENUS, resolution)
        for _ in range(subdivisions):
            vertices, faces = trimesh.remesh.subdivide(vertices, faces)
        path = folder / f"{size}.npz"
        np.savez(path, vertices=vertices, faces=faces)
        ours, theirs = in_a_process(path, "topokit"), in_a_process(path, "meshlib")
        assert ours is not None
        inside, outside = ours["lengths"]
        print(f"{len(faces):9,d} triangles, topokit: {ours['seconds']:6.1f} s, {ours['gib']:.2f} GiB, ", end="")
        print(f"{len(inside)} + {len(outside)} loops, {sum(inside):.2f} inside + {sum(outside):.2f} outside")
        if theirs is None:
            print("           meshlib is not installed: nothing to compare with")
        else:
            loops = theirs["lengths"][0]
            print(f"{'':19s} meshlib: {theirs['seconds']:6.1f} s, {theirs['gib']:.2f} GiB, ", end="")
            print(
                f"{len(loops)} loops, {sum(loops):.2f} in all; ratio of times {ours['seconds'] / theirs['seconds']:.2f}"
            )
        assert len(inside) == len(outside) == GENUS
        assert ours["seconds"] <= MOST_SECONDS, f"{ours['seconds']:.0f} s, at most {MOST_SECONDS:.0f} were asked"
        assert ours["gib"] <= MOST_GIB, f"{ours['gib']:.1f} GiB, at most {MOST_GIB:.0f} were asked"


def clean_meshes(data: Path) -> Iterator[tuple[str, int, np.ndarray, np.ndarray]]:
    for row in json.loads((data / "index.json").read_text(encoding="utf-8")):
        if row["kind"] == "mesh" and row["clean_truth"] and row["genus"]:
            vertices, faces = (part.numpy() for part in tk.load(data / row["path"]).mesh)
            yield row["name"], row["genus"], vertices.astype(np.float64), faces


def removed_one_by_one(vertices: np.ndarray, faces: np.ndarray, kind: str) -> int:
    """How many cuts or fills lead to genus 0; each must lower the genus by one. Loops that meet wait for a new look."""
    done = 0
    while found := find_handles(vertices, mesh_topology(vertices, faces), lambda *mesh: mesh):
        taken: set[int] = set()
        for handle in sorted(found, key=attrgetter(f"{kind}_length")):
            loop = getattr(handle, f"{kind}_vertices")
            if taken.isdisjoint(loop.tolist()):
                taken |= set(loop.tolist())
                genus = mesh_topology(vertices, faces).genus
                vertices, faces = without_loops(vertices, faces, [loop])
                after = mesh_topology(vertices, faces)
                assert genus is not None
                assert (after.genus, after.is_closed) == (genus - 1, True)
                done += 1
    return done


def cut_and_fill(data: Path) -> None:
    n_meshes = n_handles = 0
    for name, genus, vertices, faces in clean_meshes(data):
        started = process_time()
        found = find_handles(vertices, mesh_topology(vertices, faces), lambda *mesh: mesh)
        seconds = process_time() - started
        assert len(found) == genus, f"{name}: {len(found)} pairs of loops, {genus} expected"
        cuts, fills = (removed_one_by_one(vertices, faces, kind) for kind in ("handle", "tunnel"))
        assert cuts == fills == genus, f"{name}: {cuts} cuts and {fills} fills, {genus} expected"
        n_meshes, n_handles = n_meshes + 1, n_handles + genus
        print(f"{name:60s} genus {genus:3d}: all cut, all filled; found in {seconds:.2f} s", flush=True)
    print(f"{n_meshes} meshes, {n_handles} handles: each cut and each fill lowered the genus by one, down to 0")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--measure"]:
        print(json.dumps(measured(Path(sys.argv[2]), sys.argv[3])))
    else:
        with tempfile.TemporaryDirectory() as name:
            compare(Path(name))
        if len(sys.argv) > 1:
            cut_and_fill(Path(sys.argv[1]))
