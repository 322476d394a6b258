"""Proofs of the topology of level sets: what is proven is right, and what is singular is never proven."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from itertools import combinations, product

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from topokit.core.implicit.bounds.gradients import Zonotopes
from topokit.core.implicit.bounds.operations import program_of
from topokit.core.implicit.certificate.cells import Effort, Leaves, Octree, children, unbalanced
from topokit.core.implicit.certificate.conditions import are_met
from topokit.core.implicit.certificate.proof import Proof, prove
from topokit.core.implicit.certificate.relaxation import relaxed
from topokit.core.implicit.certificate.triangulation import Triangulation, triangulate

Function = Callable[[Tensor], Tensor]
LOW, HIGH = (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)


def proof_of(function: Function, time_limit: float = 600.0) -> Proof:
    """The proof about a function that is negative inside."""
    program = program_of(lambda x: -function(x), torch.full((1, 3), 0.1, dtype=torch.float64), "f")
    return prove(program, LOW, HIGH, Effort(seconds=time_limit))


def ball(center: tuple[float, float, float], radius: float) -> Function:
    return lambda x: (x - x.new_tensor(center)).norm(dim=1) - radius


def union(*parts: Function) -> Function:
    def function(x: Tensor) -> Tensor:
        value = parts[0](x)
        for part in parts[1:]:
            value = torch.minimum(value, part(x))
        return value

    return function


def torus(x: Tensor, major: float = 0.6, minor: float = 0.2) -> Tensor:
    return (x[:, :2].norm(dim=1) - major) ** 2 + x[:, 2] ** 2 - minor**2


def genus_two(x: Tensor) -> Tensor:
    """A tube around the lemniscate."""
    u, v, w = (1.8 * x).unbind(1)
    return (u**2 * (1 - u**2) - v**2) ** 2 + w**2 / 2 - 0.01


def blade(x: Tensor) -> Tensor:
    """A pyramid on a pyramid; along its sharp edge the mean of the two gradients points along one of them only."""
    x = x - x.new_tensor((0.013, 0.02, 0.031))
    return torch.maximum(3 * x[:, 2], -x[:, 2] / 2) + x[:, :2].abs().sum(1) / 2 - 0.3


def linked(x: Tensor) -> Tensor:
    """Two tori, each through the hole of the other."""
    first = torus(x + x.new_tensor((0.3, 0, 0)), 0.45, 0.08)
    return torch.minimum(first, torus((x - x.new_tensor((0.25, 0, 0)))[:, [0, 2, 1]], 0.45, 0.08))


KNOWN: dict[str, tuple[Function, list[int], int]] = {
    "ball": (ball((0, 0, 0), 0.7), [2], 0),
    "small ball": (ball((0.31, 0.17, -0.4), 1e-3), [2], 0),
    "hollow ball": (lambda x: (x.norm(dim=1) - 0.6).abs() - 0.05, [2, 2], 1),
    "torus": (torus, [0], 0),
    "thin torus": (lambda x: torus(x, 0.6, 0.02), [0], 0),
    "closed hole": (lambda x: torus(x, 0.4, 0.399), [0], 0),  # its hole is 0.002 wide
    "cube": (lambda x: (x.abs() - 0.5).amax(1), [2], 0),
    "octahedron": (lambda x: x.abs().sum(1) - 0.7, [2], 0),
    "notched": (lambda x: torch.maximum((x.abs() - 0.5).amax(1), 0.3 - x[:, :2].abs().amax(1)), [0], 0),
    "touching nearly": (union(ball((-0.31, 0, 0), 0.3), ball((0.31, 0, 0), 0.3)), [2, 2], 0),
    "joined nearly": (union(ball((-0.28, 0, 0), 0.3), ball((0.28, 0, 0), 0.3)), [2], 0),
    "genus two": (genus_two, [-2], 0),
    "linked": (linked, [0, 0], 0),
    "speck": (union(ball((0, 0, 0), 0.6), ball((0.71, 0.13, 0.57), 1e-4)), [2, 2], 0),
    "pinhole": (lambda x: torch.maximum(x.norm(dim=1) - 0.5, 0.02 - (x[:, :2] - 0.1).norm(dim=1)), [0], 0),
    "sharp": (blade, [2], 0),
    "four": (
        union(*(ball((a, b, 0), 0.3) for a in (-0.5, 0.5) for b in (-0.5, 0.5))),
        [2] * 4,
        0,
    ),
}


@pytest.mark.parametrize("name", KNOWN)
def test_what_is_proven_is_right(name: str) -> None:
    function, eulers, cavities = KNOWN[name]
    found = proof_of(function)
    assert found.components is not None, found.places
    assert sorted(found.components.euler.tolist()) == sorted(eulers)
    assert found.components.cavities == cavities
    assert not any(map(any, found.reached))


SINGULAR: dict[str, Function] = {
    "cone": lambda x: x[:, 0] ** 2 + x[:, 1] ** 2 - x[:, 2] ** 2,
    "touching balls": union(ball((-0.25, 0, 0), 0.25), ball((0.25, 0, 0), 0.25)),
    "point": lambda x: (x**2).sum(1),
    "edge": lambda x: torch.maximum(x[:, 0] * x[:, 1], x.norm(dim=1) - 0.5),
    "double sphere": lambda x: (x.norm(dim=1) - 0.5) ** 2,
    "horn torus": lambda x: torus(x, 0.4, 0.4),
    "cube with a shared edge": lambda x: torch.maximum(x.abs().amax(1) - 0.5, -(x[:, 0] * x[:, 1]).abs()),
    "flat": lambda x: torch.relu(x[:, 0] - 0.5),
    "zero": lambda x: 0 * x[:, 0],
    "not a number": lambda x: (x[:, 0] - 2).sqrt(),
}


@pytest.mark.parametrize("name", SINGULAR)
def test_what_is_singular_is_never_proven(name: str) -> None:
    found = proof_of(SINGULAR[name], time_limit=0.3)
    assert found.components is None
    assert found.n_open > 0
    for low, high in found.places:
        assert all(a < b for a, b in zip(low, high, strict=True))


def test_the_place_of_a_singularity_is_named() -> None:
    place = (0.123, -0.37, 0.25)
    found = proof_of(union(ball((place[0] - 0.2, *place[1:]), 0.2), ball((place[0] + 0.2, *place[1:]), 0.2)))
    [(low, high)] = found.places
    assert all(a <= at <= b and b - a < 1e-3 for at, a, b in zip(place, low, high, strict=True))


def spiked(height: float, width: float) -> Function:
    """An octahedron, with a spike that makes a part of its own."""
    center = torch.tensor([0.137, -0.244, 0.719], dtype=torch.float64)

    def function(x: Tensor) -> Tensor:
        spike = torch.relu(height - height / width * (x - center).abs().sum(1))
        return x.abs().sum(1) - 0.4 - spike

    return function


@pytest.mark.parametrize("width", [1e-2, 1e-4])
def test_a_spike_of_a_network_is_seen(width: float) -> None:
    found = proof_of(spiked(5.0, width))
    assert found.components is not None
    assert found.components.euler.tolist() == [2, 2]


@pytest.mark.parametrize(
    ("end", "is_left_out"),
    [
        (lambda f: torch.tanh(f), True),
        (lambda f: 2 - 4 * torch.sigmoid(-3 * f), True),
        (lambda f: -torch.atan(f) / 3, True),
        (lambda f: torch.sigmoid(f) - 0.4, False),
        (lambda f: torch.tanh(f) + 1e-12, False),
        (lambda f: torch.tanh(f) * f, False),
        (lambda f: torch.sin(f), False),
    ],
)
def test_ends_that_keep_the_sign_are_left_out(end: Function, is_left_out: bool) -> None:
    def function(x: Tensor) -> Tensor:
        return end(0.3 - x.abs().sum(1, keepdim=True))[:, 0]

    program = program_of(function, torch.full((1, 3), 0.1, dtype=torch.float64), "f")
    shorter = program.without_end()
    assert shorter.is_piecewise_linear == is_left_out
    points = 2 * torch.rand(500, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) - 1
    values = shorter.values(points)[:, 0]
    assert bool((values.sign() == function(points).sign()).all())
    torch.testing.assert_close(program.values(points)[:, 0], function(points))


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("activation", [nn.ReLU, nn.Tanh, nn.Softplus])
def test_random_networks_are_proven_as_fine_grids_count_them(seed: int, activation: type[nn.Module]) -> None:
    from topokit.core.grid.euler import surface_euler

    torch.manual_seed(seed)
    net = nn.Sequential(nn.Linear(3, 12), activation(), nn.Linear(12, 12), activation(), nn.Linear(12, 1)).double()

    def function(x: Tensor) -> Tensor:
        return net(4 * x)[:, 0] - net(torch.zeros(1, 3, dtype=torch.float64))[:, 0] + 0.9 * (x.norm(dim=1) - 0.5)

    found = proof_of(function)
    if found.components is None or any(map(any, found.reached)):
        pytest.skip("nothing is proven, or the surface reaches the box")
    axis = torch.linspace(-1, 1, 49, dtype=torch.float64)
    with torch.no_grad():
        values = -function(torch.cartesian_prod(axis, axis, axis)).reshape(49, 49, 49)
    counts = {int(surface_euler(values, 0.0, connectivity)) for connectivity in (6, 26)}
    assert counts == {int(found.components.euler.sum())}


def test_surfaces_that_leave_the_box_are_said_to() -> None:
    found = proof_of(lambda x: x[:, 2] - 0.1 + 0.2 * torch.sin(3 * x[:, 0]))
    assert found.components is not None
    assert found.reached == ((True, True), (True, True), (False, False))
    assert (found.components.euler.tolist(), found.components.boundary_loops.tolist()) == ([1], [1])
    corner = proof_of(ball((1, 1, 1), 0.5))
    assert corner.reached == ((False, True),) * 3
    assert corner.components is not None
    assert corner.components.boundary_loops.tolist() == [1]
    inside = proof_of(ball((0, 0, 0), 5))
    assert inside.components is not None
    assert len(inside.components) == 0
    touching = proof_of(ball((0.5, 0, 0), 0.5), time_limit=1.0)
    assert touching.components is None, "tangent to a face of the box"


def test_the_time_limit_holds() -> None:
    torch.manual_seed(0)
    net = nn.Sequential(
        nn.Linear(3, 64), nn.ReLU(), *(nn.Sequential(nn.Linear(64, 64), nn.ReLU()) for _ in range(4)), nn.Linear(64, 1)
    )
    program = program_of(net, torch.zeros(1, 3), "net")
    started = time.monotonic()
    found = prove(program, LOW, HIGH, Effort(seconds=0.5))
    assert time.monotonic() - started < 10
    assert found.components is None or found.seconds < 10


def test_a_limit_of_evaluations_gives_the_same_proof_again() -> None:
    def nearly_touching(x: Tensor) -> Tensor:
        shift = x.new_tensor((0.3, 0, 0))
        return 0.29 - torch.minimum((x - shift).norm(dim=1), (x + shift).norm(dim=1))

    program = program_of(nearly_touching, torch.zeros(1, 3, dtype=torch.float64), "f")
    whole, *limited = (prove(program, LOW, HIGH, Effort(evaluations=most)) for most in (torch.inf, 1e5, 1e5, 1e4))
    assert whole.components is not None
    assert whole.components.euler.tolist() == [2, 2]
    assert len(whole.centers) == 0
    assert [one.components for one in limited] == [None] * 3
    assert limited[0].n_cells == limited[1].n_cells > limited[2].n_cells
    assert 120 * limited[0].n_cells <= 1e5, "a cell of a norm counts as 120 evaluations"
    assert np.array_equal(limited[0].centers, limited[1].centers)
    assert len(limited[0].centers) >= limited[0].n_open == limited[1].n_open > 0


def random_tree(seed: int) -> tuple[Octree, Leaves]:
    """A balanced octree, with holes for odd seeds."""
    program = program_of(lambda x: x[:, 0] + 0.3, torch.zeros(1, 3, dtype=torch.float64), "f")
    tree = Octree(program, LOW, HIGH, Effort(seconds=60))
    generator = np.random.default_rng(seed)
    index, level = np.array(list(product(range(4), repeat=3))), np.zeros(64, dtype=np.int64)

    def divided(chosen: np.ndarray) -> None:
        nonlocal index, level
        index = np.concatenate((index[~chosen], children(index[chosen])))
        level = np.concatenate((level[~chosen], np.repeat(level[chosen] + 1, 8)))

    for depth in range(3):
        divided((level == depth) & (generator.random(len(level)) < 0.3))
    while len(wrong := unbalanced(_bounded(index, level))):
        divided(np.isin(np.arange(len(level)), wrong))
    leaves = _bounded(index, level)
    return tree, leaves.rows(np.nonzero(generator.random(len(level)) < (0.8 if seed % 2 else 1.0))[0])


def _bounded(index: np.ndarray, level: np.ndarray, n_creased: int = 0) -> Leaves:
    one = torch.ones(len(index), 3, dtype=torch.float64)
    gradient = Zonotopes(one, one[:n_creased], torch.arange(n_creased), 0 * one)
    return Leaves(index, level, gradient)


@pytest.mark.parametrize("seed", range(6))
def test_triangulations_conform(seed: int) -> None:
    tree, leaves = random_tree(seed)
    mesh = triangulate(tree, leaves, tree.values, tree.bounded_values)
    corners = mesh.positions[mesh.tetrahedra]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    sides = 2.0 / (4 * 2.0**leaves.level)
    np.testing.assert_allclose(np.bincount(mesh.owner, volumes), sides**3, rtol=1e-12)
    uses = Counter(tuple(sorted(face)) for cell in mesh.tetrahedra.tolist() for face in combinations(cell, 3))
    assert max(uses.values()) == 2
    once = [face for face, count in uses.items() if count == 1]
    if seed % 2 == 0:  # the leaves fill the box
        points = mesh.positions[np.array(once)]
        assert (np.isclose(np.abs(points), 1).all(1)).any(1).all()
        assert set(mesh.octants) == {8}
    else:  # faces with one tetrahedron are those of holes or of the box: all of their vertices can be seen from there
        at_box = np.isclose(np.abs(mesh.positions), 1).any(1)
        assert ((mesh.octants < 8) | at_box)[np.array(once)].all()
    assert bool(torch.allclose(mesh.gradient, torch.tensor([1.0, 0, 0], dtype=torch.float64), atol=1e-9))


@pytest.mark.parametrize("seed", range(4))
def test_values_stay_where_no_leaf_was_divided(seed: int) -> None:
    tree, leaves = random_tree(seed)
    leaves = _bounded(leaves.index, leaves.level, n_creased=len(leaves.level) // 2)
    before = triangulate(tree, leaves, tree.values, tree.bounded_values)
    deepest = np.nonzero(leaves.level == leaves.level.max())[0][:2]
    while len(deepest):
        parts = [_bounded(children(leaves.index[[k]])[:6], np.full(6, leaves.level[k] + 1)) for k in deepest]
        kept = np.delete(np.arange(len(leaves.level)), deepest)
        leaves = Leaves.joined([leaves.rows(kept), *parts])
        deepest = unbalanced(leaves)
    asked: list[int] = []

    def counted(points: np.ndarray) -> np.ndarray:
        asked.append(len(points))
        return tree.values(points)

    whole = triangulate(tree, leaves, tree.values, tree.bounded_values)
    part = triangulate(tree, leaves, counted, tree.bounded_values, before)
    for name in ("vertices", "octants", "is_sure", "is_free", "reach", "tetrahedra", "owner"):
        assert np.array_equal(getattr(part, name), getattr(whole, name)), name
    np.testing.assert_allclose(part.value, whole.value, rtol=0, atol=1e-15)
    assert bool(torch.allclose(part.gradient, whole.gradient, atol=1e-9))
    assert whole.is_new.all()
    assert 0 < part.is_new.sum() == asked[0] < len(part.value) / 2
    other = triangulate(tree, leaves, tree.values, tree.bounded_values, before.with_values(before.value + 1))
    np.testing.assert_allclose(other.value - whole.value, np.where(part.is_new, 0, 1), atol=1e-12)


def test_conditions_fail_where_values_are_wrong() -> None:
    """The same leaves with another interpolation: a dent, and a wrong sign beside a cell without surface."""
    program = program_of(ball((0, 0, 0), 0.5), torch.full((1, 3), 0.1, dtype=torch.float64), "f")
    tree = Octree(program, LOW, HIGH, Effort(seconds=60))
    leaves = tree.divide(children(children(np.array(list(product(range(4), repeat=3))))), 2)
    good = triangulate(tree, leaves, tree.values, tree.bounded_values)

    def is_met(mesh: Triangulation) -> np.ndarray:
        return are_met(leaves, mesh, tree.touched(leaves.index, leaves.level), np.arange(len(leaves.level)))

    assert is_met(good).all()
    near = good.positions[np.argmin(np.abs(good.value) + (good.octants < 8))]

    def dented(points: np.ndarray) -> np.ndarray:
        return tree.values(points) + 0.2 * (points == near).all(1)

    dent = triangulate(tree, leaves, dented, tree.bounded_values)
    fails = np.nonzero(~is_met(dent))[0]
    assert len(fails)
    mended = relaxed(leaves, dent, fails)
    assert is_met(mended)[fails].all()
    beside_empty = good.octants < 8
    assert ((mended.value > 0) == (dent.value > 0))[beside_empty].all()

    def unsure(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, error = tree.bounded_values(points)
        return value, error + 2.0

    refused = ~is_met(triangulate(tree, leaves, tree.values, unsure))
    beside = np.unique(good.owner[(good.octants[good.tetrahedra] < 8).any(1)])
    assert refused[beside].all()


def test_leaves_that_are_too_unequal_are_found() -> None:
    index = np.array([(0, 0, 0), (4, 0, 0), (4, 4, 0), (4, 4, 4), (3, 0, 0)])
    level = np.array([0, 2, 2, 2, 0])
    assert unbalanced(_bounded(index, level)).tolist() == [0], "by a face and an edge, not by a corner alone"
    assert unbalanced(_bounded(index[[0, 3]], level[[0, 3]])).tolist() == []
