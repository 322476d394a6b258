"""The proof that a level set has the topology of a triangulated surface.

Theorem. Let f be Lipschitz on a box B, K a conforming set of tetrahedra in B, and L continuous, linear in each of them.
Suppose that

1. f is not 0 outside of K, and at every vertex of K beside such a place L has the sign of f;
2. every tetrahedron σ lies in a cell C with a set G(C) that holds ∂f(x), Clarke's gradient, for all x in C; and for
   each cell one of these holds, g_σ being the gradient of L in σ:
   S. ⟨g_σ, η⟩ > 0 for all η in G(C) and all σ in C;
   V. there is a direction v with ⟨v, η⟩ > 0 for all η in G(C), and ⟨v, g_σ⟩ > 0 for all σ that touch C;
3. cells that touch the faces of B across a set T of axes satisfy S with g_σ replaced by its projection along the axes
   U, too, for every subset U of T.

Then an isotopy of B takes {f > 0} to {L > 0}, where L is continued outside of K with the sign of f.

Proof. Let f_t = (1 − t) f + t L, and f_t(x) = 0. By 1, x is in K only. Clarke's gradient ∂f_t(x) lies in
(1 − t) ∂f(x) + t hull{g_σ : σ ∋ x}. There is a vector v with ⟨v, ∂f_t(x)⟩ > 0, the same for all t: if x touches a cell
with V, its v. Else let v be the shortest element of the convex set ∂f(x), which is not 0 by S: ⟨v, ξ⟩ ≥ |v|² for all ξ
in ∂f(x), and ⟨v, g_σ⟩ > 0 by S, as v is in G(C) for all cells C ∋ x. On the faces of B the same holds for the
projections of all vectors by 3, so that v can be tangent to them. ∂f_t is upper semicontinuous, so v serves in a
neighborhood of (x, t); a partition of unity gives a smooth field V on B, tangent to its faces, along which f_s rises
strictly near {f_t = 0} for all s near t. Each flow line of V near {f_t = 0} meets {f_s = 0} once: an isotopy
from t to s; finitely many of them, as [0, 1] is compact, lead from f to L. ∎

L need not be close to f, nor its values exact: that is what the tests are for. With S, subdivision ends wherever f is
smooth and 0 is a regular value; V serves at creases of any angle.

References:
    Plantinga and Vegter, "Isotopic approximation of implicit curves and surfaces", SGP 2004 (a test of this kind for
    smooth functions: ⟨G, G⟩ > 0 in intervals). Boissonnat, Cohen-Steiner, Vegter, "Isotopic implicit surface meshing",
    Discrete & Computational Geometry 39, 2008, DOI 10.1007/s00454-007-9011-5 (isotopies by f_t). Clarke, Optimization
    and Nonsmooth Analysis, 1983.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.components import Corner, CountedComponents
from topokit.core.implicit.bounds.program import Program
from topokit.core.implicit.certificate.cells import DEEPEST, Effort, Leaves, Octree, unbalanced
from topokit.core.implicit.certificate.conditions import are_met
from topokit.core.implicit.certificate.relaxation import leaves_near, relaxed
from topokit.core.implicit.certificate.triangulation import Triangulation, triangulate
from topokit.core.mesh.topology import mesh_topology
from topokit.core.surface import TriangleSurface

Place = tuple[Corner, Corner]
_TESTED = 80  # evaluations of the function that take as long as testing the conditions in a leaf
_ROUNDS = 4  # of relaxing values where the conditions fail, before cells are divided


@dataclass(frozen=True, eq=False)
class Proof:
    """What is proven about a level set in a box.

    Attributes:
        components: of the surface, where it is proven, else None.
        surface: triangles isotopic to it, likewise; None if it is empty, too.
        reached: for each axis, whether the surface reaches the lower and the upper face of the box.
        places: boxes around the cells in which nothing is proven, largest first; none if all is.
        n_open: those cells.
        centers: (n, 3) of all cells that are open or may hold the surface, if some are open; else none.
        n_cells: cells whose bounds were computed.
        n_leaves: cells in which the surface is a graph.
        smallest: side of the smallest cell.
        seconds: time it took.
    """

    components: CountedComponents | None
    surface: TriangleSurface | None
    reached: tuple[tuple[bool, bool], ...]
    places: tuple[Place, ...]
    n_open: int
    centers: Floats
    n_cells: int
    n_leaves: int
    smallest: float
    seconds: float


def prove(program: Program, low: Corner, high: Corner, effort: Effort) -> Proof:
    """Prove the topology of {f = 0} in a box, as far as an effort allows.

    Args:
        program: f, positive inside.
        low: lowest corner of the box.
        high: highest corner.
        effort: what it may cost.
    """
    started = time.monotonic()
    tree = Octree(program.without_end(), low, high, effort)
    leaves = tree.start()
    mesh, is_met = None, np.zeros(len(leaves.level), dtype=bool)
    while not tree.open:
        chosen = unbalanced(leaves)
        if not len(chosen):
            tree.cost += _TESTED * len(leaves.level)
            if tree.is_over():
                tree.open = [(leaves.index[leaves.level == k], k) for k in np.unique(leaves.level).tolist()]
                break
            mesh = triangulate(tree, leaves, tree.values, tree.bounded_values, mesh)
            mesh, is_met = _tested(tree, leaves, mesh, is_met)
            chosen = np.nonzero(~is_met)[0]
            if not len(chosen):
                break
        leaves = _divided(tree, leaves, chosen)
        is_met = np.delete(is_met, chosen)
        is_met = np.concatenate((is_met, np.zeros(len(leaves.level) - len(is_met), dtype=bool)))
    places, n_open = _places(tree)
    surface = None if mesh is None or n_open else mesh.surface()
    reached = _reached(tree, surface)
    components = None
    if not n_open:
        components = (
            CountedComponents.none() if surface is None or not len(surface.faces) else _counted(surface, reached)
        )
    return Proof(
        components=components,
        surface=surface,
        reached=reached,
        places=places,
        n_open=n_open,
        centers=_centers(tree, leaves),
        n_cells=tree.n_bounded,
        n_leaves=len(leaves.level),
        smallest=float((tree.side / tree.root).max() / 2.0**tree.deepest),
        seconds=time.monotonic() - started,
    )


def _divided(tree: Octree, leaves: Leaves, chosen: Integers) -> Leaves:
    """The leaves with some divided; those of the smallest size, or after the deadline, are open instead."""
    is_kept = np.ones(len(leaves.level), dtype=bool)
    is_kept[chosen] = False
    parts = [leaves.rows(np.nonzero(is_kept)[0])]
    for level in np.unique(leaves.level[chosen]).tolist():
        cells = leaves.index[chosen[leaves.level[chosen] == level]]
        if level == DEEPEST or tree.is_over(8 * len(cells)):
            tree.open.append((cells, level))
        else:
            parts.append(tree.divide(cells, level))
    return Leaves.joined(parts)


def _tested(tree: Octree, leaves: Leaves, mesh: Triangulation, is_met: Booleans) -> tuple[Triangulation, Booleans]:
    """The triangulation with values relaxed beside creases, and (n,) whether leaves satisfy the conditions.

    Args:
        tree: of the leaves.
        leaves: n.
        mesh: their triangulation.
        is_met: (n,) which of them satisfied the conditions in the triangulation before. They are tested again where it
            changed, and once more when all seem to satisfy them: the proof rests on one test of all.
    """
    touched = tree.touched(leaves.index, leaves.level)
    is_changed = mesh.is_new.copy()
    is_changed[mesh.tetrahedra[~is_met[mesh.owner]]] = True
    near = leaves_near(mesh, is_changed)
    is_first, is_met = not is_met.any(), is_met.copy()
    is_met[near] = are_met(leaves, mesh, touched, near)
    bent: Booleans = np.zeros(len(is_met), dtype=bool)
    for _ in range(_ROUNDS if tree.program.has_kinks else 0):  # where f is smooth, dividing is cheaper
        fails = ~is_met & ~touched.any(1)
        if tree.is_over() or not (fails & ~bent).any():
            break
        bent |= fails
        before, mesh = mesh, relaxed(leaves, mesh, np.nonzero(bent)[0])
        near = leaves_near(mesh, mesh.value != before.value)
        is_met[near] = are_met(leaves, mesh, touched, near)
    if is_met.all() and not is_first:
        is_met = are_met(leaves, mesh, touched, np.arange(len(is_met)))
    return mesh, is_met


def _places(tree: Octree) -> tuple[tuple[Place, ...], int]:
    """Boxes around the open cells, joined where they touch on a grid of the largest of them."""
    if not tree.open:
        return (), 0
    n_open = sum(len(cells) for cells, _ in tree.open)
    boxes = [tree.bounds(cells, level) for cells, level in tree.open]
    low, high = (np.concatenate(column) for column in zip(*boxes, strict=True))
    coarsest = min(min(level for _, level in tree.open), 6)
    shape = tree.root << coarsest
    at = np.clip(((low + high) / 2 - tree.low) / tree.side * shape, 0, shape - 1).astype(np.int64)

    grid = np.zeros(shape, dtype=bool)
    grid[tuple(at.T)] = True
    labels, count = label(grid, np.ones((3, 3, 3)))
    of = labels[tuple(at.T)] - 1
    lowest, highest = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(lowest, of, low)
    np.maximum.at(highest, of, high)
    order = np.argsort(-(highest - lowest).max(1), kind="stable")
    return tuple((tuple(lowest[k].tolist()), tuple(highest[k].tolist())) for k in order), n_open


def _centers(tree: Octree, leaves: Leaves) -> Floats:
    """(n, 3) of open cells and of leaves, if any are open."""
    if not tree.open:
        return np.zeros((0, 3))
    levels = np.unique(leaves.level).tolist()
    cells = [*tree.open, *((leaves.index[leaves.level == level], level) for level in levels)]
    return np.concatenate([np.mean(tree.bounds(*part), axis=0) for part in cells])


def _reached(tree: Octree, surface: TriangleSurface | None) -> tuple[tuple[bool, bool], ...]:
    """Whether the surface ends at the faces of the box."""
    if surface is None or not len(surface.vertices):
        return ((False, False),) * 3
    ends = tree.low, tree.low + tree.side
    near = [np.isclose(surface.vertices, end, rtol=0, atol=1e-12 * tree.side.max()).any(0) for end in ends]
    return tuple((bool(near[0][axis]), bool(near[1][axis])) for axis in range(3))


def _counted(surface: TriangleSurface, reached: tuple[tuple[bool, bool], ...]) -> CountedComponents:
    found = mesh_topology(surface.vertices, surface.faces)
    is_sound = found.is_manifold and found.is_orientable and (found.is_closed or any(map(any, reached)))
    if not is_sound:
        raise AssertionError("a proven surface must be a manifold that ends at the faces of the box only")
    return found.components
