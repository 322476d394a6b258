"""Mending of volumes and meshes: planted errors, against tuned morphology, and time against the number of handles.

    python -m benchmarks.mending volumes 500 --morphology 60  # planted errors in vessels, sheets and organs
    python -m benchmarks.mending volume FILE.npz --below 3   # one volume ("vol", "spacing") against morphology
    python -m benchmarks.mending large 256 --errors 125      # few small errors in a large volume, against one count
    python -m benchmarks.mending stored 1024 --errors 8000   # the same in a file, block by block
    python -m benchmarks.mending meshes 64 96 128 192        # noisy tori from marching cubes

Every truth is wider than the width below which is mended, and every planted error narrower, so that the truth's Betti
numbers are the right answer. Morphology may choose, for each volume, among opening, closing and both in either order
with balls of four radii, each followed by filling cavities and keeping the largest part, or not: the fewest wrong Betti
numbers, then the fewest changed voxels.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise, product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_fill_holes, distance_transform_edt, gaussian_filter, label, zoom
from skimage.measure import marching_cubes

import topokit as tk
from topokit.core.grid.betti import betti_numbers
from topokit.core.mesh.defects import intersecting_faces
from topokit.core.mesh.topology import mesh_topology

Solid = NDArray[np.bool_]
Draw = np.random.Generator

N = 56
X, Y, Z = np.meshgrid(*[np.arange(N) - N / 2 + 0.5] * 3, indexing="ij")
WIDTHS = (1, 2, 3, 4, 5, 6)
RADII = (1.0, 1.5, 2.5, 3.5)


def ball(center: NDArray[np.float64], width: float) -> Solid:
    return (X - center[0]) ** 2 + (Y - center[1]) ** 2 + (Z - center[2]) ** 2 <= (width / 2) ** 2 + 1e-9


def bar(first: NDArray[np.float64], last: NDArray[np.float64], width: float) -> Solid:
    """Voxels closer than half a width to a segment."""
    way = last - first
    along = ((X - first[0]) * way[0] + (Y - first[1]) * way[1] + (Z - first[2]) * way[2]) / (way @ way)
    along = np.clip(along, 0, 1)
    squares = ((at - first[k] - along * way[k]) ** 2 for k, at in enumerate((X, Y, Z)))
    return sum(squares) <= (width / 2) ** 2 + 1e-9


def organ(draw: Draw, width: int) -> tuple[Solid, Solid]:
    """An ellipsoid, half of them with a wide tunnel; bubbles, channels, specks and arches."""
    radii = draw.uniform(18, 20, 3)
    truth = (X / radii[0]) ** 2 + (Y / radii[1]) ** 2 + (Z / radii[2]) ** 2 <= 1
    has_tunnel = bool(draw.random() < 0.5)
    if has_tunnel:
        truth &= ~((X + 2) ** 2 + Y**2 < 27)
    flawed = truth.copy()
    if not has_tunnel:  # beside a tunnel a channel would leave no wide wall
        flawed &= ~bar(np.array([11.0, 0, -30]), np.array([11.0, 0, 30]), width)
    side = np.sign(draw.normal())
    flawed |= ball(np.array([25.0, side * 25, -25]), width)
    flawed &= ~ball(np.array([0, side * 12.0, 0]), width)
    corners = np.array([[-10.0, -side * y, z] for y, z in ((9, 9), (25, 9), (25, -9), (9, -9))])
    for first, last in pairwise(corners):
        flawed |= bar(first, last, width)
    return truth, flawed


def vessel(draw: Draw, width: int) -> tuple[Solid, Solid]:
    """A thick ring with a branch, which is broken, has a bubble, and a false bridge across the ring."""
    turn = draw.uniform(0, 0.5)
    truth = (np.hypot(np.hypot(X, Y) - 15, Z) <= 5) | bar(np.array([15.0, 0, 0]), np.array([15.0, 0, 24]), 10)
    flawed = truth & ~((X > 5) & (abs(Z - 12) <= width / 2))
    start = 15 * np.array([np.cos(2 + turn), np.sin(2 + turn), 0])
    flawed |= bar(start, 15 * np.array([np.cos(4.5 - turn), np.sin(4.5 - turn), 0]), width)
    flawed &= ~ball(np.array([-2.0, -15, 0]), min(width, 5))
    return truth, flawed


def sheet(draw: Draw, width: int) -> tuple[Solid, Solid]:
    """A wavy sheet five voxels thick with holes."""
    height = 3 * np.sin(X / draw.uniform(6, 9)) + 2 * np.cos(Y / draw.uniform(6, 9))
    truth = (abs(Z - height) <= 2.5) & (abs(X) < 24) & (abs(Y) < 24)
    flawed = truth.copy()
    for x, y in ((-10, -12), (11, 8), (-6, 13)):
        shift = draw.uniform(-2, 2, 2)
        flawed &= ~bar(np.array([x + shift[0], y + shift[1], -30]), np.array([x + shift[0], y + shift[1], 30]), width)
    return truth, flawed


KINDS: tuple[Callable[[Draw, int], tuple[Solid, Solid]], ...] = (organ, vessel, sheet)


def scores(solid: Solid, draw: Draw) -> NDArray[np.float32]:
    """What a network might predict: probabilities by depth, with noise that leaves the solid as it is."""
    depth = distance_transform_edt(solid) - distance_transform_edt(~solid)
    noise = gaussian_filter(draw.normal(size=solid.shape), 2)
    value = 1 / (1 + np.exp(-depth / 2 - 0.1 * noise / noise.std() * np.sign(depth)))
    return np.where(solid, np.maximum(value, 0.51), np.minimum(value, 0.49)).astype(np.float32)


def grown(solid: Solid, radius: float) -> Solid:
    return distance_transform_edt(~np.pad(solid, 8))[8:-8, 8:-8, 8:-8] <= radius


def shrunk(solid: Solid, radius: float) -> Solid:
    return ~grown(~solid, radius)


def morphology(solid: Solid) -> Iterator[Solid]:
    """Candidates: opening, closing and both, then cavities filled and small parts dropped, or not."""
    for radius in RADII:
        closed, opened = shrunk(grown(solid, radius), radius), grown(shrunk(solid, radius), radius)
        for one in (
            *(closed, opened, grown(shrunk(closed, radius), radius), shrunk(grown(opened, radius), radius)),
            *(solid,),
        ):
            yield one
            labels, count = label(one, np.ones((3, 3, 3)))
            if count:
                yield binary_fill_holes(labels == np.bincount(labels.ravel())[1:].argmax() + 1)


def betti(solid: Solid) -> NDArray[np.int64]:
    return betti_numbers(solid).numpy()


def best_morphology(solid: Solid, wanted: NDArray[np.int64]) -> tuple[int, int, Solid]:
    """Wrong Betti numbers, changed voxels, and the solid."""
    found = (
        (int(abs(betti(one) - wanted).sum()), int((one != solid).sum()), k, one)
        for k, one in enumerate(morphology(solid))
    )
    wrong, changed, _, one = min(found, key=lambda it: it[:3])
    return wrong, changed, one


def dice(one: Solid, other: Solid) -> float:
    return float(2 * (one & other).sum() / (one.sum() + other.sum()))


def volumes(count: int, n_compared: int) -> None:
    rows, others = [], []
    for number in range(count):
        draw = np.random.default_rng(number)
        width, kind, is_gray = WIDTHS[number % 6], KINDS[number // 6 % 3], bool(number // 18 % 2)
        truth, flawed = kind(draw, width)
        wanted = betti(truth)
        shape = tk.from_voxels(scores(flawed, draw), level=0.5) if is_gray else tk.from_voxels(flawed)
        begin = time.process_time()
        mended = shape.simplify(below=width + 1.5, components=kind is not sheet)
        seconds = time.process_time() - begin
        after = mended.field.is_inside(mended.field.volume).numpy()
        own = int(abs(np.array(mended.betti().solid) - wanted).sum())
        first = int(abs(betti(flawed) - wanted).sum())
        rows.append((own, mended.simplification.changed, dice(after, truth), first, dice(flawed, truth), seconds))
        if number < n_compared:
            wrong, changed, other = best_morphology(flawed, wanted)
            others.append((wrong, changed, dice(other, truth)))
        if own:
            print(
                f"volume {number}: {kind.__name__}, width {width}, gray {is_gray}: {mended.betti().solid}, not {wanted}"
            )
    own, changed, overlap, first, first_overlap, seconds = np.array(rows).T
    print(f"{count} volumes, {np.mean(first == 0):.1%} right before, Dice {first_overlap.mean():.4f}")
    print(f"simplify: {_told(own, changed, overlap)}, {seconds.mean():.2f} CPU s each")
    print(f"Dice not lower than before in {np.mean(overlap >= first_overlap - 1e-12):.1%}")
    if others:
        _compare(np.array(rows)[:n_compared, :3].T, np.array(others).T)


def _compare(own: NDArray[np.float64], others: NDArray[np.float64]) -> None:
    """Wrong Betti numbers, changed voxels and overlap (3, N) of both."""
    print(f"of the first {own.shape[1]}: simplify: {_told(*own)}; tuned morphology: {_told(*others)}")
    ratio = own[1] / np.maximum(others[1], 1)
    print(f"changed, against morphology: median {np.median(ratio):.3f}, at most 1/3 in {np.mean(ratio <= 1 / 3):.1%}")
    print(f"Dice not lower than morphology's in {np.mean(own[2] >= others[2] - 1e-12):.1%}")


def _told(wrong: NDArray[np.float64], changed: NDArray[np.float64], overlap: NDArray[np.float64]) -> str:
    voxels = f"{np.median(changed):.0f} voxels changed in the median, {changed.sum():.0f} in all"
    return f"{np.mean(wrong == 0):.1%} right, {voxels}, Dice {overlap.mean():.4f}"


def volume(path: str, below: float) -> None:
    with np.load(path) as archive:
        inside, spacing = archive["vol"] > 0, tuple(np.broadcast_to(archive["spacing"], 3).astype(float).tolist())
    shape = tk.from_voxels(inside, spacing=spacing)
    begin = time.process_time()
    shape.report()
    counting = time.process_time() - begin
    begin = time.process_time()
    mended = shape.simplify(below=below)
    seconds = time.process_time() - begin
    print(f"{mended.simplification.summary()} {seconds:.1f} CPU s; one count {counting:.1f} s.")
    for one in morphology(inside):
        print(f"morphology: {tuple(betti(one).tolist())}, {(one != inside).sum()} voxels changed")


def blocks(size: int, draw: Draw) -> Solid:
    """Cubes of 16 voxels, each filled or empty; many touch along an edge only, which is a narrow place."""
    filled = draw.random((size // 16,) * 3) < 0.5
    return np.kron(filled, np.ones((16, 16, 16), dtype=bool))


def smooth(size: int, draw: Draw) -> Solid:
    """A sponge with walls and pores of about 20 voxels."""
    noise = gaussian_filter(draw.normal(size=(size // 2,) * 3).astype(np.float32), 4, mode="wrap")
    return zoom(noise, 2, order=1) > 0


def large(size: int, n_errors: int, repeats: int) -> None:
    """Times of mending as multiples of those of a count, each of a new shape."""
    tk.from_voxels(blocks(64, np.random.default_rng(1))).simplify(below=2.0)  # what is compiled
    for kind in (blocks, smooth):
        draw = np.random.default_rng(0)
        volume = kind(size, draw)
        volume[tuple(draw.integers(0, size, (3, n_errors)))] ^= True
        seconds = np.empty((repeats, 2))
        for row in seconds:
            for column in range(2):
                shape = tk.from_voxels(volume)
                begin = time.process_time()
                made = shape.simplify(below=2.0) if column else shape.report()
                row[column] = time.process_time() - begin
            summary = "" if made.simplification is None else made.simplification.summary()
        ratios = np.round(seconds[:, 1] / seconds[:, 0], 1).tolist()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        print(f"{size}³ {kind.__name__}, {n_errors} errors: {ratios} times a count, {seconds.round(2).tolist()} CPU s")
        print(f"  {summary} Most memory so far: {peak:.1f} GiB")


def stored(size: int, n_errors: int) -> None:
    """Mending of a sponge in a file, block by block; the sponge repeats after 256 voxels."""
    draw = np.random.default_rng(0)
    tile = smooth(256, draw).astype(np.uint8)
    with tempfile.TemporaryDirectory() as name:
        source, result = Path(name) / "sponge.npy", Path(name) / "mended.npy"
        volume = np.lib.format.open_memmap(source, "w+", np.uint8, (size,) * 3)
        for x, y, z in product(range(0, size, 256), repeat=3):
            volume[x : x + 256, y : y + 256, z : z + 256] = tile
        volume[tuple(draw.integers(0, size, (3, n_errors)))] ^= 1
        volume.flush()
        del volume
        shape = tk.from_voxels(source, block_voxels=1 << 24)
        begin = time.process_time()
        shape.report()
        counting = time.process_time() - begin
        begin = time.process_time()
        made = shape.simplify(below=2.0, out=result)
        seconds = time.process_time() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"{size}³, {n_errors} errors: {seconds:.0f} CPU s, one count {counting:.1f}. Most memory: {peak:.2f} GiB")
    print(f"  {made.simplification.summary()}")
    print(f"  removed: {Counter((one.kind, one.how) for one in made.simplification.removals)}")
    print(f"  not settled: {Counter((one.kind, round(one.width, 1)) for one in made.simplification.unsettled)}")


def noisy_torus(size: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The largest component of a torus with noise of the same number of voxels at every size."""
    axis = np.linspace(-1, 1, size)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    noise = gaussian_filter(np.random.default_rng(0).normal(size=x.shape), 1)
    field = 0.3 - np.hypot(np.hypot(x, y) - 0.6, z) + 0.6 * 64 / size * noise
    vertices, faces, *_ = marching_cubes(np.pad(field, 1, constant_values=-1), 0)
    topology = mesh_topology(vertices.astype(float), faces.astype(np.int64))
    used, own = np.unique(topology.faces[topology.face_labels == 0], return_inverse=True)
    return vertices[used].astype(float), own.reshape(-1, 3)


def meshes(sizes: list[int]) -> None:
    points = []
    tk.from_mesh(*noisy_torus(32)).simplify(below=6.0, components=False)  # what is compiled
    for size in sizes:
        vertices, faces = noisy_torus(size)
        shape = tk.from_mesh(vertices, faces)
        genus, before = shape.genus(), len(intersecting_faces(vertices, faces))
        begin = time.process_time()
        mended = shape.simplify(below=6.0, components=False)
        seconds = time.process_time() - begin
        points_after, faces_after = (part.numpy() for part in mended.mesh)
        after = len(intersecting_faces(points_after.astype(float), faces_after))
        moved = int((points_after[: len(vertices)] != vertices).any(axis=1).sum())
        points.append((genus - mended.genus(), seconds))
        print(f"{size}³: {len(faces)} faces, genus {genus} → {mended.genus()} in {seconds:.1f} CPU s")
        print(f"  intersecting pairs {before} → {after}; {moved} of {len(vertices)} vertices moved")
    if len(points) > 1:
        handles, seconds = np.log(np.array(points)).T
        print(f"slope of time in handles: {np.polyfit(handles, seconds, 1)[0]:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    planted = commands.add_parser("volumes")
    planted.add_argument("count", type=int)
    planted.add_argument("--morphology", type=int, required=True, metavar="N", help="compare the first N with it")
    one = commands.add_parser("volume")
    one.add_argument("path")
    one.add_argument("--below", type=float, required=True)
    many = commands.add_parser("large")
    many.add_argument("size", type=int)
    many.add_argument("--errors", type=int, required=True)
    many.add_argument("--repeats", type=int, default=3)
    in_file = commands.add_parser("stored")
    in_file.add_argument("size", type=int)
    in_file.add_argument("--errors", type=int, required=True)
    commands.add_parser("meshes").add_argument("sizes", type=int, nargs="+")
    given = parser.parse_args()
    if given.command == "volumes":
        volumes(given.count, given.morphology)
    elif given.command == "volume":
        volume(given.path, given.below)
    elif given.command == "large":
        large(given.size, given.errors, given.repeats)
    elif given.command == "stored":
        stored(given.size, given.errors)
    else:
        meshes(given.sizes)


if __name__ == "__main__":
    main()
