"""The conditions of the theorem in `proof`, tested in leaves of an octree."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor
from torch.nn.functional import normalize

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.implicit.bounds.gradients import Zonotopes, nearer_to_zero
from topokit.core.implicit.certificate.cells import Leaves, rises
from topokit.core.implicit.certificate.triangulation import Triangulation

_SEARCHED = 24  # steps of the search for a direction
_CHUNK = 1 << 16  # leaves tested together
_TOGETHER = 8  # tetrahedra of each, likewise


def are_met(leaves: Leaves, mesh: Triangulation, touched: Booleans, rows: Integers) -> Booleans:
    """(m,) whether leaves satisfy the conditions.

    Args:
        leaves: n.
        mesh: their triangulation.
        touched: (n, 3) whether each touches the box's faces across each axis.
        rows: (m,) ascending numbers of those to test.
    """
    met: Booleans = ~np.isin(rows, mesh.owner[mesh.have(~mesh.is_sure)])
    for places in _chunks(len(rows)):
        own = rows[places]
        place = np.full(len(leaves.level), -1)
        place[own] = np.arange(len(own))
        tetrahedra = np.nonzero(place[mesh.owner] >= 0)[0]
        tetrahedra = tetrahedra[np.argsort(place[mesh.owner[tetrahedra]], kind="stable")]
        owner = place[mesh.owner[tetrahedra]]
        part = leaves.gradient.rows(torch.from_numpy(own))
        fails = ~_all_rise(part, mesh, tetrahedra, owner, touched[own])
        met[places[fails]] &= _has_direction(leaves, mesh, own[fails], touched)
    return met


def _chunks(count: int) -> Iterator[Integers]:
    return (np.arange(start, min(start + _CHUNK, count)) for start in range(0, count, _CHUNK))


def _all_rise(
    gradient: Zonotopes, mesh: Triangulation, tetrahedra: Integers, owner: Integers, touched: Booleans
) -> Booleans:
    """Condition S for each of n cells, with its variants at the faces of the box."""
    count = np.bincount(owner, minlength=len(touched))
    first = np.cumsum(count) - count
    passed: Booleans = count > 0
    for start in range(0, int(count.max(initial=0)), _TOGETHER):
        cells = np.nonzero(count > start)[0]
        wanted = np.minimum(np.arange(start, start + _TOGETHER), count[cells, None] - 1)  # the last is repeated
        chosen = torch.from_numpy(tetrahedra[first[cells, None] + wanted])
        near = torch.from_numpy(touched[cells])
        part = gradient.rows(torch.from_numpy(cells))
        passed[cells] &= rises(part, mesh.gradient[chosen], near, mesh.slack[chosen]).numpy()
    return passed


def _has_direction(leaves: Leaves, mesh: Triangulation, rows: Integers, touched: Booleans) -> Booleans:
    """Condition V for some leaves: by directions of their own, else by those of `directions`, which are dear."""
    found = np.zeros(len(rows), dtype=bool)
    for is_shared in (False, True):
        left = np.nonzero(~found & ~touched[rows].any(1))[0]
        if not len(left):
            break
        pairs = cell, tetrahedron = touching(mesh, rows[left], len(leaves.level))
        if is_shared:
            direction, least = directions(leaves, mesh, rows[left], pairs)
        else:
            direction, least = _own_directions(leaves.gradient.rows(torch.from_numpy(rows[left])))
        along, vectors = direction[cell], mesh.gradient[tetrahedron]
        error = 1e-12 * (along * vectors).abs().sum(1) + (along.abs() * mesh.slack[tetrahedron]).sum(1)
        falls = cell[((along * vectors).sum(1) <= error).numpy()]
        found[left] = (least > 0) & (np.bincount(falls, minlength=len(left)) == 0)
    return found


def touching(mesh: Triangulation, rows: Integers, n_leaves: int) -> tuple[Integers, Integers]:
    """Pairs of a place in `rows` and a tetrahedron that shares a vertex with that leaf."""
    place = np.full(n_leaves, -1)
    place[rows] = np.arange(len(rows))
    own = np.nonzero(place[mesh.owner] >= 0)[0]
    is_near = np.zeros(len(mesh.value), dtype=bool)
    is_near[mesh.tetrahedra[own]] = True
    near = np.nonzero(mesh.have(is_near))[0]
    of_leaf = _incidence(place[mesh.owner[own]], mesh.tetrahedra[own], (len(rows), len(is_near)))
    of_near = _incidence(np.arange(len(near)), mesh.tetrahedra[near], (len(near), len(is_near)))
    cell, number = (of_leaf @ of_near.T).nonzero()
    return cell.astype(np.int64), near[number]


def _incidence(number: Integers, corners: Integers, shape: tuple[int, int]) -> csr_array:
    """A matrix that is not 0 where something with a number (n,) has one of the corners (n, 4)."""
    entries = np.repeat(number, corners.shape[1]), corners.ravel()
    return csr_array((np.ones(corners.size, dtype=np.int32), entries), shape=shape)


def directions(
    leaves: Leaves, mesh: Triangulation, rows: Integers, pairs: tuple[Integers, Integers]
) -> tuple[Tensor, Floats]:
    """(m, 3) unit, directions in which the function rises in leaves, and (m,) how fast at least; not positive if none.

    They are those in which it rises in all leaves near, if there are such.

    Args:
        leaves: all.
        mesh: their triangulation.
        rows: (m,) numbers of leaves.
        pairs: of `touching`.
    """
    cell, tetrahedron = pairs
    distinct = np.unique(np.stack((cell, mesh.owner[tetrahedron]), axis=1), axis=0)
    together = leaves.gradient.taken(torch.from_numpy(distinct[:, 1]))
    shared = normalize(_shared_direction(together, torch.from_numpy(distinct[:, 0])), dim=1)
    own = leaves.gradient.rows(torch.from_numpy(rows))
    least = own.least(shared[:, None])[:, 0].numpy()
    alone, least_alone = _own_directions(own)
    is_shared = least > 0
    return torch.where(torch.from_numpy(is_shared)[:, None], shared, alone), np.where(is_shared, least, least_alone)


def _own_directions(own: Zonotopes) -> tuple[Tensor, Floats]:
    """The same for the gradients of single leaves, whatever is near."""
    center, shortest = (normalize(one, dim=1) for one in (own.center, own.shortest()))
    found = torch.where(own.least(center[:, None]) > 0, center, shortest)
    return found, own.least(found[:, None])[:, 0].numpy()


def _shared_direction(sets: Zonotopes, group: Tensor) -> Tensor:
    """(n, 3) about the shortest vectors of the hulls of groups of sets (see `Zonotopes.shortest`).

    Args:
        sets: m.
        group: (m,) ascending, 0 … n − 1, all of them.
    """
    count = torch.bincount(group)
    found = sets.center.new_zeros(len(count), 3).index_add(0, group, sets.center) / count[:, None]
    for _ in range(_SEARCHED):
        lowest = sets.lowest(found[group])
        products = (found[group] * lowest).sum(1)
        least = products.new_full((len(count),), torch.inf).scatter_reduce(0, group, products, "amin")
        is_least = (products == least[group]).double()[:, None]
        total = torch.zeros_like(found).index_add(0, group, lowest * is_least)
        found = nearer_to_zero(found, total / found.new_zeros(len(count), 1).index_add(0, group, is_least))
    return found
