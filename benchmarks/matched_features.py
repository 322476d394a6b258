"""Comparing two solids: against the definition, under symmetries, against Betti matching, and with planted errors.

    python -m benchmarks.matched_features oracle 500
    python -m benchmarks.matched_features symmetry 500
    python -m benchmarks.matched_features official 500 LIBRARY
    python -m benchmarks.matched_features cost 128 6 [LIBRARY]
    python -m benchmarks.matched_features places 128 6
    python -m benchmarks.matched_features planted 200
    python -m benchmarks.matched_features blocks 384

The first three end after a number of seconds that can follow, 600 by default. Their pairs have 26³ to 48³ voxels, and
are sparse solids with tunnels or dense ones with cavities, 6- and 26-connected in turn.
LIBRARY is the compiled module betti_matching of topolosses 0.2 (MIT), which is not a dependency; "ours" is
`matching="betti-matching"`.
"""

from __future__ import annotations

import importlib.util
import resource
import sys
import time
from collections import Counter
from itertools import permutations, product, takewhile
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy import ndimage

import topokit as tk
from topokit.comparison.solids import compare_solids
from topokit.core.comparison.pair import SolidPair
from topokit.core.comparison.tie_broken import betti_matched

CONNECTIVITIES = (6, 26)
MIRRORED = 100  # pairs that are given to the judge a second time


def random_pair(n: int, seed: int, sigmas: tuple[float, float], level: float):
    """Level sets of smoothed noise, the second one disturbed by other noise."""
    generator = np.random.default_rng(seed)
    one, other = (ndimage.gaussian_filter(generator.standard_normal((n,) * 3), sigma) for sigma in sigmas)
    one /= one.std()
    return one > level, one + 0.4 * other / other.std() > level


def seeds(n_pairs: int, seconds: float):
    """So many numbers, but none after some time."""
    started = time.perf_counter()
    return takewhile(lambda _: time.perf_counter() - started < seconds, range(n_pairs))


def drawn_pair(seed: int, n: int | None = None):
    """One of the random pairs, of n³ voxels."""
    return random_pair(n or 26 + seed % 23, seed, (1.5, 1.2), 0.7 if seed % 4 < 2 else -0.7)


def oracle(n_pairs: int, seconds: int = 600) -> None:
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
    from mapping_cylinder import matched_by_persistence

    equal, n_features, n_done = 0, np.zeros(3, int), 0
    for seed in seeds(n_pairs, seconds):
        connectivity, pair = CONNECTIVITIES[seed % 2], drawn_pair(seed)
        found = SolidPair(*pair, connectivity).numbers
        rows = list(zip(found.first, found.second, found.matched, strict=True))
        equal, n_done = equal + (rows == matched_by_persistence(*pair, connectivity)), n_done + 1
        n_features += found.matched
    print(f"equal to the definition in all dimensions: {equal} of {n_done}, 26³ to 48³, matched {n_features.tolist()}")


def symmetry(n_pairs: int, seconds: int = 600) -> None:
    same, n_done = 0, 0
    moves = list(product(permutations(range(3)), product((1, -1), repeat=3)))
    for seed in seeds(n_pairs, seconds):
        pair = drawn_pair(seed, 26 + (seed % 23) ** 2 // 22)  # more small ones
        moved = (
            [one.transpose(axes)[tuple(slice(None, None, k) for k in steps)] for one in pair] for axes, steps in moves
        )
        found = {SolidPair(*one, CONNECTIVITIES[seed % 2]).numbers for one in moved}
        same, n_done = same + (len(found) == 1), n_done + 1
    print(f"the same under 48 symmetries: {same} of {n_done} pairs, 26³ to 48³")


def official(n_pairs: int, library: str, seconds: int = 600) -> None:
    judge, equal, changed, n_done = _judge(library), Counter(), 0, 0
    for seed in seeds(n_pairs, seconds):
        pair = drawn_pair(seed)
        found = SolidPair(*pair, 6).numbers
        theirs = np.add(judge(*pair), (1, 0, 0))  # it leaves out the part that never ends
        equal.update(k for k in range(3) if theirs[k] == found.matched[k])
        equal.update({"betti-matching": tuple(theirs) == betti_matched(*pair)})
        n_done += 1
        if n_done <= MIRRORED:
            changed += judge(*(one[::-1].copy() for one in pair))[1] != theirs[1]
    in_all = equal.pop("betti-matching")
    print(f"equal to Betti matching: {dict(sorted(equal.items()))} of {n_done}, 26³ to 48³, 6-connected")
    print(f"in all dimensions, by matching='betti-matching': {in_all} of {n_done}")
    print(f"its tunnels change when both volumes are mirrored along one axis: {changed} of the first {MIRRORED}")


def cost(n: int, connectivity: int, library: str | None = None) -> None:
    SolidPair(*random_pair(8, 0, (1, 1), 0.5), connectivity).numbers  # noqa: B018  (compiles)
    judge = None if library is None else betti_matched if library == "ours" else _judge(library)
    pair = random_pair(n, 300, (4, 4), 0.8)
    before, started = _peak(), time.process_time()
    matched = judge(*pair) if judge else SolidPair(*pair, connectivity).numbers.matched
    what = str(connectivity) if library is None else f"Betti matching, {Path(library).stem}"
    print(
        f"{n}³, {what}: {time.process_time() - started:.2f} CPU s, "
        f"{_peak() - before:.2f} GiB more than before, matched {tuple(int(m) for m in matched)}"
    )


def places(n: int, connectivity: int) -> None:
    """All places of a pair, beside its numbers."""
    compare_solids(*random_pair(16, 0, (1, 1), 0.5), connectivity=connectivity).features  # noqa: B018  (compiles)
    pair, started = random_pair(n, 300, (4, 4), 0.8), time.process_time()
    found = compare_solids(*pair, connectivity=connectivity)
    counted = time.process_time()
    loops = [one.length for one in found.features if one.length is not None]
    located, counted = time.process_time() - counted, counted - started
    print(
        f"{n}³, {connectivity}: numbers {counted:.2f} CPU s, {len(found.features)} places {located:.2f} CPU s; "
        f"{len(loops)} loops of {sum(loops):.0f} steps for {found.betti_matching_error[1]} tunnels"
    )


def blocks(n: int) -> None:
    """Files of n³ voxels with features of tens of voxels, n a multiple of 4."""
    tk.compare_blocks(*random_pair(8, 0, (1, 1), 0.5))  # compiles
    coarse = random_pair(n // 4, 0, (2, 2), 0.8)
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{name}.npy" for name in "ab"]
        for path, solid in zip(paths, coarse, strict=True):
            file = np.lib.format.open_memmap(path, mode="w+", dtype=np.uint8, shape=(n, n, n))
            for x in range(n):
                file[x] = np.kron(solid[x // 4], np.ones((4, 4), np.uint8))
        del file
        before, started = _peak(), time.process_time()
        found = tk.compare_blocks(*paths)
        seconds, more = time.process_time() - started, _peak() - before
    print(f"{n}³ block by block: {seconds:.2f} CPU s, {more:.2f} GiB more than before; {found}")


def planted(n_each: int) -> None:
    found = Counter()
    for kind, seed in product(("split part", "bridge", "hole", "bubble", "broken loop"), range(n_each)):
        generator = np.random.default_rng(seed)
        truth, changed, planted = _PLANTS[kind](generator)
        prediction = truth ^ planted
        one = compare_solids(prediction, truth, connectivity=26)
        low, high = np.argwhere(planted).min(0) - 0.5, np.argwhere(planted).max(0) + 0.5
        is_found = [feature.kind for feature in one.features] == [kind]
        centers = np.array([feature.center for feature in one.features])
        is_there = is_found and bool(((low - 1 <= centers) & (centers <= high + 1)).all())
        found[kind, changed] += is_there
    for (kind, what), count in found.items():
        print(f"{kind} in {what}: found and located {count} of {n_each}")


def _tree(generator, n: int = 48):
    """A random walk of a tube of radius 2 from one side to the other; it has no loops."""
    solid, at = np.zeros((n, n, n), bool), np.array([4, n // 2, n // 2])
    for x in range(4, n - 4):
        solid[x, at[1], at[2]] = True
        step = generator.integers(-1, 2, 2)
        at[1:] = np.clip(at[1:] + step, 8, n - 9)
        solid[x, at[1], at[2]] = True
    ball = np.linalg.norm(np.mgrid[-2:3, -2:3, -2:3], axis=0) <= 2.1
    return ndimage.binary_dilation(solid, ball)


def _break(generator):
    truth, x = _tree(generator), int(generator.integers(14, 34))
    gap = np.zeros_like(truth)
    gap[x : x + 2] = True
    return truth, "a vessel", truth & gap


def _bridge(generator):
    truth = np.zeros((40, 40, 24), bool)
    x, y = generator.integers(8, 30, 2)
    truth[4:36, 4:36, 4:7] = truth[4:36, 4:36, 16:19] = truth[4:7, 4:36, 4:19] = True
    planted = np.zeros_like(truth)
    planted[x : x + 2, y : y + 2, 7:16] = True
    return truth, "two sheets", planted


def _pinhole(generator):
    truth = np.zeros((40, 40, 24), bool)
    truth[4:36, 4:36, 9:12] = True
    x, y = generator.integers(6, 32, 2)
    planted = np.zeros_like(truth)
    planted[x : x + 1 + int(generator.integers(2)), y, 9:12] = True
    return truth, "a sheet", planted


def _bubble(generator):
    truth = _tree(generator)
    inner = np.argwhere(ndimage.binary_erosion(truth, np.ones((3, 3, 3))))
    planted = np.zeros_like(truth)
    planted[tuple(inner[generator.integers(len(inner))])] = True
    return truth, "a vessel", planted


def _broken(generator):
    truth = np.zeros((40, 40, 12), bool)
    x, y, z = np.ogrid[:40, :40, :12]
    around = np.hypot(np.hypot(x - 19.5, y - 19.5) - 13, z - 5.5)
    truth |= around < 2.6
    turn, angle = generator.random() * 6.28, np.arctan2(x - 19.5, y - 19.5) + 0 * z
    return truth, "a loop", truth & (np.abs((angle - turn + np.pi) % (2 * np.pi) - np.pi) < 0.12)


_PLANTS = {"split part": _break, "bridge": _bridge, "hole": _pinhole, "bubble": _bubble, "broken loop": _broken}


def _judge(library: str):
    spec = importlib.util.spec_from_file_location("betti_matching", library)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def matched(first, second):
        result = module.compute_matching(*(np.where(one, 0.0, 1.0) for one in (first, second)))
        return np.array(result.num_matched)

    return matched


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


if __name__ == "__main__":
    commands = (blocks, oracle, symmetry, official, cost, places, planted)
    {command.__name__: command for command in commands}[sys.argv[1]](
        *(int(word) if word.isdigit() else word for word in sys.argv[2:])
    )
