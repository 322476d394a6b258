"""Tasks for topology losses: six kinds of change, three shapes each, on grids and on neural fields.

    python benchmarks/topology_tasks.py                           18 tasks on 64³ grids and 18 on neural fields
    python benchmarks/topology_tasks.py --losses topology euler persistence --fields grid --size 40
    python benchmarks/topology_tasks.py --change any --only close
    python benchmarks/topology_tasks.py --more                    ten other tasks

Every task starts from a field that is fitted to noisy observations of a shape: truncated signed distances (at 0.2, in a
box of side 2) at all grid points, with noise of 0.02. The data term is the mean squared difference to these
observations. A task is reached when marching cubes and V − E + F count the wanted surfaces and χ, and the data term is
at most 1.1 times its value at the start. The losses have neither weight nor τ; all tasks share steps
and learning rates.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import gudhi
import numpy as np
import torch
import trimesh
from skimage.measure import marching_cubes
from torch import Tensor, nn

import topokit as tk
from topokit.core.grid.tau import default_tau

TRUNCATION, NOISE = 0.2, 0.02
SHARED = {"grid": {"steps": 200, "rate": 2e-3}, "neural": {"steps": 400, "rate": 1e-3}}

Solid = Callable[[Tensor], Tensor]  # (..., 3) to (...), roughly the signed distance, negative inside


def ball(*center: float, r: float) -> Solid:
    return lambda p: (p - p.new_tensor(center)).norm(dim=-1) - r


def torus(x: float, major: float, minor: float) -> Solid:
    return lambda p: torch.hypot(torch.hypot(p[..., 0] - x, p[..., 1]) - major, p[..., 2]) - minor


def box(*half: float, x: float = 0.0) -> Solid:
    def distance(p: Tensor) -> Tensor:
        over = (p - p.new_tensor((x, 0.0, 0.0))).abs() - p.new_tensor(half)
        return over.clamp_min(0).norm(dim=-1) + over.amax(-1).clamp_max(0)

    return distance


def cylinder(r: float, half: float, x: float = 0.0, z: float = 0.0, axis: int = 2) -> Solid:
    def distance(p: Tensor) -> Tensor:
        q = (p - p.new_tensor((x, 0.0, z))).roll(2 - axis, -1)
        over = torch.stack((q[..., :2].norm(dim=-1) - r, q[..., 2].abs() - half), -1)
        return over.clamp_min(0).norm(dim=-1) + over.amax(-1).clamp_max(0)

    return distance


def union(*solids: Solid) -> Solid:
    return lambda p: torch.stack([solid(p) for solid in solids]).amin(0)


def without(solid: Solid, *others: Solid) -> Solid:
    return lambda p: torch.stack([solid(p), *(-other(p) for other in others)]).amax(0)


@dataclass(frozen=True)
class Task:
    """A change of topology: the shape at the start, and the wanted components, tunnels and cavities."""

    kind: str
    name: str
    solid: Solid
    betti: tuple[int, int, int]

    @property
    def change(self) -> str:
        return "add" if self.kind in ("close", "join", "fill") else "remove"


_LONG = box(0.8, 0.45, 0.25)
TASKS = (
    Task("close", "torus", torus(0, 0.5, 0.25), (1, 0, 0)),
    Task("close", "plate", without(box(0.7, 0.6, 0.2), cylinder(0.2, 1)), (1, 0, 0)),
    Task("close", "one of two", without(_LONG, cylinder(0.2, 1, 0.4), cylinder(0.12, 1, -0.4)), (1, 1, 0)),
    Task("drill", "webbed torus", union(torus(0, 0.55, 0.25), cylinder(0.5, 0.07)), (1, 1, 0)),
    Task(
        "drill", "red cell", without(cylinder(0.7, 0.3), ball(0, 0, 0.75, r=0.62), ball(0, 0, -0.75, r=0.62)), (1, 1, 0)
    ),
    Task("drill", "blind hole", without(_LONG, cylinder(0.2, 1, 0.4), cylinder(0.2, 0.38, -0.4, 0.5)), (1, 2, 0)),
    Task("join", "balls", union(ball(-0.42, 0, 0, r=0.33), ball(0.42, 0, 0, r=0.35)), (1, 0, 0)),
    Task("join", "broken rod", without(cylinder(0.2, 0.8, axis=0), box(0.09, 1, 1)), (1, 0, 0)),
    Task("join", "two rings", union(torus(-0.48, 0.3, 0.12), torus(0.48, 0.3, 0.12)), (1, 2, 0)),
    Task(
        "split",
        "dumbbell",
        union(ball(-0.5, 0, 0, r=0.32), ball(0.5, 0, 0, r=0.32), cylinder(0.11, 0.5, axis=0)),
        (2, 0, 0),
    ),
    Task(
        "split", "boxes", union(box(0.3, 0.4, 0.4, x=-0.45), box(0.3, 0.4, 0.4, x=0.45), box(0.3, 0.1, 0.15)), (2, 0, 0)
    ),
    Task("split", "two rings", union(torus(-0.38, 0.28, 0.13), torus(0.38, 0.28, 0.13)), (2, 2, 0)),
    Task("remove", "floater", union(ball(-0.2, 0, 0, r=0.5), ball(0.65, 0.3, 0.3, r=0.13)), (1, 0, 0)),
    Task(
        "remove",
        "two of a torus",
        union(torus(0, 0.5, 0.2), ball(0.7, 0.7, 0.6, r=0.12), ball(-0.7, -0.6, -0.6, r=0.15)),
        (1, 1, 0),
    ),
    Task("remove", "plate", union(box(0.4, 0.4, 0.4, x=-0.3), box(0.05, 0.3, 0.3, x=0.6)), (1, 0, 0)),
    Task("fill", "ball", without(ball(0, 0, 0, r=0.7), ball(0.1, 0, 0.1, r=0.17)), (1, 0, 0)),
    Task(
        "fill",
        "two in a box",
        without(box(0.75, 0.5, 0.5), ball(0.35, 0, 0, r=0.17), ball(-0.35, 0.1, 0, r=0.13)),
        (1, 0, 0),
    ),
    Task("fill", "torus", without(torus(0, 0.5, 0.3), ball(0.5, 0, 0, r=0.14)), (1, 1, 0)),
)


_SLAB = box(0.85, 0.4, 0.2)
MORE = (
    Task("close", "window", without(box(0.7, 0.6, 0.15), box(0.2, 0.2, 1)), (1, 0, 0)),
    Task(
        "close",
        "one of three",
        without(_SLAB, cylinder(0.12, 1, 0.5), cylinder(0.12, 1), cylinder(0.1, 1, -0.5)),
        (1, 2, 0),
    ),
    Task("drill", "dimples", without(box(0.6, 0.6, 0.3), ball(0, 0, 0.5, r=0.42), ball(0, 0, -0.5, r=0.42)), (1, 1, 0)),
    Task(
        "drill",
        "plugged pipe",
        without(cylinder(0.4, 0.8), cylinder(0.22, 0.37, z=0.45), cylinder(0.22, 0.37, z=-0.45)),
        (1, 1, 0),
    ),
    Task("join", "three balls", union(*(ball(x, 0, 0, r=0.25) for x in (-0.6, 0, 0.6))), (1, 0, 0)),
    Task("join", "cut ring", without(torus(0, 0.55, 0.2), box(0.07, 1, 1)), (1, 1, 0)),
    Task(
        "split",
        "beads",
        union(*(ball(x, 0, 0, r=0.24) for x in (-0.62, 0, 0.62)), cylinder(0.09, 0.6, axis=0)),
        (3, 0, 0),
    ),
    Task("remove", "crumbs", union(box(0.5, 0.4, 0.3), ball(0.8, 0, 0, r=0.1), ball(0, 0.7, 0.6, r=0.12)), (1, 0, 0)),
    Task(
        "fill",
        "three in a rod",
        without(cylinder(0.35, 0.85), *(ball(0, 0, z, r=0.13) for z in (-0.5, 0, 0.5))),
        (1, 0, 0),
    ),
    Task(
        "fill",
        "one of a ring",
        without(torus(0, 0.55, 0.28), ball(0, 0.55, 0, r=0.13), ball(0, -0.55, 0, r=0.13)),
        (1, 1, 0),
    ),
)


def grid_points(size: int) -> Tensor:
    axis = torch.linspace(-1, 1, size)
    return torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1)


def noisy_distances(task: Task, size: int) -> Tensor:
    """Noisy truncated distances on the grid, positive inside."""
    clean = -task.solid(grid_points(size)).clamp(-TRUNCATION, TRUNCATION)
    return clean + NOISE * torch.randn(clean.shape, generator=torch.Generator().manual_seed(0))


class GridModel(nn.Module):
    """Grid values as parameters, with a smoothness penalty."""

    fit_steps, fit_rate = 200, 5e-3

    def __init__(self, data: Tensor) -> None:
        super().__init__()
        self.data = data
        self.values = nn.Parameter(data.clone())

    def field(self) -> Tensor:
        return self.values

    source = field

    def data_term(self) -> Tensor:
        return (self.values - self.data).square().mean()

    def objective(self, generator: torch.Generator) -> Tensor:
        neighbors = sum(self.values.roll(step, axis) for step in (-1, 1) for axis in range(3))
        bending = (neighbors - 6 * self.values)[1:-1, 1:-1, 1:-1].square().mean()
        return self.data_term() + 0.5 * bending


class NeuralModel(nn.Module):
    """A network with three hidden layers of 64 and three octaves of positional encoding."""

    fit_steps, fit_rate = 1500, 3e-3
    batch = 8192

    def __init__(self, data: Tensor) -> None:
        super().__init__()
        torch.manual_seed(0)
        self.size = len(data)
        self.points, self.data = grid_points(self.size).reshape(-1, 3), data.reshape(-1)
        layers = [layer for a, b in pairwise([21, 64, 64, 64]) for layer in (nn.Linear(a, b), nn.Softplus(beta=30))]
        self.layers = nn.Sequential(*layers, nn.Linear(64, 1))
        bounds = ((-1.0,) * 3, (1.0,) * 3)
        self.shape = tk.from_sdf(lambda p: -self(p), bounds=bounds, field_resolution=self.size - 1)

    def forward(self, points: Tensor) -> Tensor:
        waves = [points * (math.pi * 2**octave / 2) for octave in range(3)]
        features = [points, *(wave.sin() for wave in waves), *(wave.cos() for wave in waves)]
        return self.layers(torch.cat(features, -1))[..., 0]

    def source(self) -> tk.Shape:
        return self.shape

    def field(self, size: int | None = None) -> Tensor:
        size = size or self.size
        return self(grid_points(size).reshape(-1, 3)).reshape(size, size, size)

    def data_term(self) -> Tensor:
        return (self(self.points) - self.data).square().mean()

    def objective(self, generator: torch.Generator) -> Tensor:
        batch = torch.randint(len(self.points), (self.batch,), generator=generator)
        return (self(self.points[batch]) - self.data[batch]).square().mean()


Model = GridModel | NeuralModel
MODELS: dict[str, type[Model]] = {"grid": GridModel, "neural": NeuralModel}


class PersistenceLoss:
    """Persistent homology of the cubical complex with torch gradients.

    For the probability sigmoid(F / scale), the wanted number of longest bars of each dimension gets the target length
    one, all others zero (J. Clough et al., "A topological loss function for deep-learning based image segmentation
    using persistent homology", TPAMI 2020, doi:10.1109/TPAMI.2020.3013679).
    """

    def __init__(self, betti: tuple[int, int, int], scale: float) -> None:
        self.betti, self.scale = betti, scale

    def __call__(self, field: Tensor) -> Tensor:
        height = torch.sigmoid(field / self.scale).reshape(-1)
        cells = 1 - height.detach().double().reshape(field.shape).numpy()
        complex_ = gudhi.CubicalComplex(top_dimensional_cells=cells)
        complex_.compute_persistence(homology_coeff_field=2)
        finite, essential = complex_.cofaces_of_persistence_pairs()
        total = height.new_zeros(())
        for dimension, wanted in enumerate(self.betti):
            pairs = finite[dimension] if dimension < len(finite) else np.zeros((0, 2), dtype=int)
            births = torch.as_tensor(np.ascontiguousarray(pairs[:, 0]), dtype=torch.long)
            deaths = torch.as_tensor(np.ascontiguousarray(pairs[:, 1]), dtype=torch.long)
            length = height[births] - height[deaths]
            if dimension < len(essential):
                length = torch.cat((height[torch.as_tensor(essential[dimension], dtype=torch.long)], length))
            length = length.sort(descending=True).values
            total = total + (1 - length[:wanted]).square().sum() + length[wanted:].square().sum()
        return total


Step = Callable[[int], Tensor]


def step_of(loss: str, model: Model, task: Task, change: str | None) -> Step:
    """The loss as a function of the step."""
    components, tunnels, cavities = task.betti
    if loss == "topology":
        topology = tk.TopologyLoss(betti=task.betti, change=change or task.change)
        return lambda step: topology(model.source(), keys=task.name)
    euler = tk.EulerLoss(2.0 * (components - tunnels + cavities))
    if loss == "euler":
        return lambda step: euler(model.source())
    persistence = PersistenceLoss(task.betti, 2 * default_tau(model.field().detach()))
    return lambda step: persistence(model.field())


@dataclass(frozen=True)
class Outcome:
    """Result of a task.

    Attributes:
        found: surfaces and χ.
        is_right: whether they are the wanted ones.
        data: data term as a multiple of its start.
        milliseconds: per step.
    """

    found: tuple[int, int]
    is_right: bool
    data: float
    milliseconds: float

    @property
    def is_reached(self) -> bool:
        return self.is_right and self.data <= 1.1


def fit(kind: str, task: Task, size: int) -> Model:
    model = MODELS[kind](noisy_distances(task, size))
    optimizer = torch.optim.Adam(model.parameters(), model.fit_rate)
    decay = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, model.fit_steps)
    generator = torch.Generator().manual_seed(0)
    for _ in range(model.fit_steps):
        optimizer.zero_grad()
        model.objective(generator).backward()
        optimizer.step()
        decay.step()
    return model


def train(model: Model, task: Task, loss: Step, steps: int, rate: float) -> Outcome:
    before = float(model.data_term().detach())
    optimizer = torch.optim.Adam(model.parameters(), rate)
    decay = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    generator = torch.Generator().manual_seed(1)
    started = time.perf_counter()
    for step in range(steps):
        optimizer.zero_grad()
        (model.objective(generator) + loss(step)).backward()
        optimizer.step()
        decay.step()
    milliseconds = 1e3 * (time.perf_counter() - started) / steps
    fields = [model.field().detach()]
    if isinstance(model, NeuralModel):
        fields.append(model.field(64).detach())  # and on a grid that was not used in training
    components, tunnels, cavities = task.betti
    wanted = components + cavities, 2 * (components - tunnels + cavities)
    found = [count_surfaces(field) for field in fields]
    return Outcome(
        found[-1], all(one == wanted for one in found), float(model.data_term().detach()) / before, milliseconds
    )


def count_surfaces(field: Tensor) -> tuple[int, int]:
    """Connected surfaces and V − E + F of the mesh by marching cubes."""
    padded = np.pad(field.double().numpy(), 1, constant_values=-1.0)
    if not (padded > 0).any():
        return 0, 0
    vertices, faces, _, _ = marching_cubes(padded, 0.0)
    mesh = trimesh.Trimesh(vertices, faces)
    return int(mesh.body_count), int(mesh.euler_number)


def run_tasks(arguments: argparse.Namespace) -> Iterator[tuple[str, Task, dict[str, Outcome]]]:
    for kind in arguments.fields:
        size = arguments.size or {"grid": 64, "neural": 40}[kind]
        for task in MORE if arguments.more else TASKS:
            if arguments.only and task.kind not in arguments.only:
                continue
            start = fit(kind, task, size).state_dict()
            outcomes = {}
            for loss in arguments.losses:
                model = MODELS[kind](noisy_distances(task, size))
                model.load_state_dict(start)
                step = step_of(loss, model, task, arguments.change)
                outcomes[loss] = train(model, task, step, **SHARED[kind])
            yield kind, task, outcomes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--losses", nargs="+", choices=("topology", "euler", "persistence"), default=["topology"])
    parser.add_argument("--fields", nargs="+", choices=tuple(MODELS), default=list(MODELS))
    parser.add_argument("--size", type=int, help="grid points along a side (64 for grids, 40 for neural fields)")
    parser.add_argument("--change", choices=("any",), help="let TopologyLoss add and remove material")
    parser.add_argument("--more", action="store_true", help="ten other tasks")
    parser.add_argument("--only", nargs="+", choices=sorted({task.kind for task in TASKS}))
    arguments = parser.parse_args()
    print("| field | kind | shape | loss | surfaces, χ | topology | data term | reached | ms per step |")
    print("|---|---|---|---|---|---|---|---|---|")
    reached: dict[tuple[str, str], list[bool]] = {}
    for kind, task, outcomes in run_tasks(arguments):
        for loss, one in outcomes.items():
            reached.setdefault((kind, loss), []).append(one.is_reached)
            print(
                f"| {kind} | {task.kind} | {task.name} | {loss} | {one.found[0]}, {one.found[1]} | "
                f"{'right' if one.is_right else 'wrong'} | × {one.data:.3f} | {'yes' if one.is_reached else 'no'} | "
                f"{one.milliseconds:.0f} |",
                flush=True,
            )
    for (kind, loss), several in reached.items():
        print(f"{kind}, {loss}: {sum(several)} of {len(several)} reached")


if __name__ == "__main__":
    main()
