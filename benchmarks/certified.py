"""What `certify` proves and what proofs cost: the figures of docs/certify.md.

    python -m benchmarks.certified surfaces           # known level sets, and singular ones
    python -m benchmarks.certified boxes 1000000      # random boxes per operation, and 10 000 per network
    python -m benchmarks.certified bumps 100          # networks with a bump of 1e-4 of the box
    python -m benchmarks.certified networks DATA 600  # signed distance networks, so many seconds each
    python -m benchmarks.certified growth 60          # cells, seconds and memory by depth and width
    python -m benchmarks.certified reports DATA NAME  # reports without and with a proof, also of networks

Seconds are those of all cores together, unless said otherwise.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

import topokit as tk
from benchmarks.bounded_operations import OPERATIONS, outside
from benchmarks.known_level_sets import KNOWN, SINGULAR, Function
from benchmarks.surfaces import network
from topokit.core.implicit.bounds.operations import program_of
from topokit.core.implicit.certificate.cells import Effort
from topokit.core.implicit.certificate.proof import Proof, prove

BOX = (-1.0,) * 3, (1.0,) * 3
LIMIT = 600.0


def proof_of(function: Function, limit: float = LIMIT) -> Proof:
    """The proof about a function that is negative inside."""
    example = torch.full((1, 3), 0.1, dtype=torch.float64)
    return prove(program_of(lambda x: -function(x), example, "f"), *BOX, Effort(seconds=limit))


def counted(proof: Proof) -> tuple[tuple[int, ...], int, int] | None:
    """Characteristics of the components, cavities and boundary loops that are proven."""
    found = proof.components
    if found is None:
        return None
    return tuple(sorted(found.euler.tolist())), found.cavities, int(found.boundary_loops.sum())


def surfaces(first: str = "sphere") -> None:
    """Known level sets, then singular ones; those from one name on."""
    everything = [*KNOWN, *SINGULAR]
    wrong = 0
    for name in everything[everything.index(first) :]:
        started = time.process_time()
        if name in SINGULAR:
            proof = proof_of(SINGULAR[name], 5.0)
            verdict = "open" if proof.components is None else "WRONG"
        else:
            known = KNOWN[name]
            proof = proof_of(known.function)
            found = counted(proof)
            verdict = "open" if found is None else "WRONG"
            verdict = "right" if found == (known.eulers, known.cavities, known.loops) else verdict
        wrong += verdict == "WRONG"
        seconds = time.process_time() - started
        print(f"{name:32} {verdict} {counted(proof)}; {proof.n_cells} cells, {seconds:.1f} CPU s", flush=True)
    assert not wrong


def boxes(count: str) -> None:
    """Random boxes per operation: values and gradients outside of their bounds, which must be none."""
    total = 0
    for name, function in OPERATIONS.items():
        wrong = outside(function, int(count), seed=0)
        total += wrong
        print(f"{name:20} {count} boxes, {wrong} outside", flush=True)
    for seed in range(20):
        wrong = outside(random_network(2 + seed % 3, 16, seed), 10_000, seed)
        total += wrong
        print(f"network {seed:12} 10000 boxes, {wrong} outside", flush=True)
    assert not total


def random_network(depth: int, width: int, seed: int) -> Function:
    """A network of ReLUs about a ball, weights in single precision."""
    torch.manual_seed(seed)
    layers: list[nn.Module] = [nn.Linear(3, width), nn.ReLU()]
    for _ in range(depth - 1):
        layers += [nn.Linear(width, width), nn.ReLU()]
    net = nn.Sequential(*layers, nn.Linear(width, 1)).requires_grad_(False)
    for module in net:
        if isinstance(module, nn.Linear):
            nn.init.kaiming_uniform_(module.weight, nonlinearity="relu")
    weights = [(m.weight.T.double(), m.bias.double()) for m in net if isinstance(m, nn.Linear)]

    def function(x: Tensor) -> Tensor:
        y = x
        for number, (weight, bias) in enumerate(weights):
            y = torch.addmm(bias, torch.relu(y) if number else y, weight)
        return 0.1 * y[:, 0] + x.abs().sum(1) - 0.7

    return function


def bumps(count: str) -> None:
    """Networks with a bump that makes a part of 1e-4 of the box: proven are two parts, or nothing."""
    found = {"with the bump": 0, "open": 0}
    for seed in range(int(count)):
        base, generator = random_network(2, 16, seed), np.random.default_rng(seed)
        while True:
            center = torch.from_numpy(generator.uniform(-0.95, 0.95, (1, 3)))
            if (value := float(base(center))) > 0.1:
                break

        def function(x: Tensor, base: Function = base, center: Tensor = center, value: float = value) -> Tensor:
            return base(x) - torch.relu(2 * value * (1 - (x - center).abs().sum(1) / 1e-4))

        plain, bumped = counted(proof_of(base, 60.0)), counted(proof_of(function, 60.0))
        if bumped is None:
            found["open"] += 1
            continue
        assert plain is None or bumped[0] == tuple(sorted((*plain[0], 2))), (seed, plain, bumped)
        assert 2 in bumped[0], (seed, bumped)
        found["with the bump"] += 1
    print(found)


def rows_of(data: str) -> list[dict[str, Any]]:
    """What a collection says of its networks."""
    rows: list[dict[str, Any]] = json.loads((Path(data) / "index.json").read_text("utf-8"))
    return [row for row in rows if row["kind"] == "sdfnet"]


def networks(data: str, limit: str, *names: str) -> None:
    """The networks of a collection: what is proven, and whether it is the known characteristic."""
    for row in rows_of(data):
        if names and row["name"] not in names:
            continue
        started = time.process_time()
        proof = proof_of(network(Path(data) / row["path"]), float(limit))
        found = None if proof.components is None else int(proof.components.euler.sum())
        verdict = "open" if found is None else "new" if row["chi"] is None else "right"
        verdict = "WRONG" if found is not None and row["chi"] not in (None, found) else verdict
        print(
            f"{row['name']:20} {row.get('net_class')}: {verdict} {found}; {proof.n_open} cells open; "
            f"{proof.n_cells} cells, {time.process_time() - started:.0f} CPU s",
            flush=True,
        )


def growth(limit: str) -> None:
    """Cells, seconds and memory of random networks by depth and width."""
    for depth, width in ((2, 32), (2, 64), (2, 128), (2, 256), (4, 32), (8, 32), (4, 64), (8, 64), (8, 256)):
        started = time.process_time()
        proof = proof_of(random_network(depth, width, 0), float(limit))
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        state = "proven" if proof.components is not None else f"{proof.n_open} cells open"
        print(
            f"{depth} x {width}: {state}; {proof.n_cells} cells, {time.process_time() - started:.1f} CPU s, "
            f"{memory:.0f} MiB",
            flush=True,
        )


def reports(data: str = "", *names: str) -> None:
    """What a report pays for a proof beside its grids."""
    functions: dict[str, Function] = {name: KNOWN[name].function for name in ("sphere", "torus", "genus 2 plate")}
    functions |= {f"{d} x {w} ReLUs": random_network(d, w, 0) for d, w in ((2, 32), (8, 32), (4, 128))}
    functions |= {row["name"]: network(Path(data) / row["path"]) for row in rows_of(data) if row["name"] in names}
    tk.from_sdf(random_network(2, 8, 0), bounds=(-1, 1)).report()  # compiles
    for name, function in functions.items():
        verdicts, seconds = [], []
        for certify in (False, None):
            started = np.array((time.process_time(), time.monotonic()))
            verdicts.append(tk.from_sdf(function, bounds=(-1, 1)).report(certify=certify).verdict)
            seconds.append(np.array((time.process_time(), time.monotonic())) - started)
        ratios = seconds[1] / seconds[0]
        print(
            f"{name:20} {' -> '.join(verdicts)}; CPU {seconds[0][0]:.1f} -> {seconds[1][0]:.1f} s ({ratios[0]:.2f}), "
            f"time {seconds[0][1]:.1f} -> {seconds[1][1]:.1f} s ({ratios[1]:.2f})",
            flush=True,
        )


if __name__ == "__main__":
    asked = (surfaces, boxes, bumps, networks, growth, reports)
    {one.__name__: one for one in asked}[sys.argv[1]](*sys.argv[2:])
