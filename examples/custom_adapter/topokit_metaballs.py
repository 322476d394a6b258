"""Metaballs: balls that blend into each other, as a text file of centers and radii."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from topokit import Adapter
from topokit.errors import ReadError
from topokit.plugins import head, reading

if TYPE_CHECKING:
    import torch

    from topokit import Shape


class Metaballs(Adapter):
    """The surface on which Σ exp(1 − |p − cᵢ|²/rᵢ²) is 1: for a single ball, the sphere of radius r.

    A file begins with the line `metaballs N`, and each of the N lines after it is `x y z radius`.
    """

    name = "metaballs"
    description = "metaballs: centers and radii as text"
    suffixes = (".metaballs",)

    def can_open(self, source: Path) -> bool:
        return head(source).startswith(b"metaballs ")

    def open(
        self,
        source: Path,
        *,
        resolution: int = 256,
        n_samples: int = 10_000,
        generator: torch.Generator | None = None,
    ) -> Shape:
        import topokit

        centers, radii = _read(source)

        def below(p: torch.Tensor) -> torch.Tensor:
            """(N, 3) to (N,), negative inside."""
            squares = (p[:, None].double() - centers).square().sum(dim=-1)
            return 1 - (1 - squares / radii**2).exp().sum(dim=-1)

        reach = float(radii.max()) * math.sqrt(1 + math.log(len(radii))) * 1.05  # if all balls were in one place
        bounds = (centers.amin(dim=0) - reach).tolist(), (centers.amax(dim=0) + reach).tolist()
        return topokit.from_sdf(below, bounds=bounds, resolution=resolution, n_samples=n_samples, generator=generator)


def _read(path: Path) -> tuple[torch.Tensor, torch.Tensor]:
    """Centers (N, 3) and radii (N,)."""
    import torch

    with reading(path, "the metaballs reader"):
        _, count, *numbers = path.read_text(encoding="utf-8").split()
        table = torch.tensor([float(number) for number in numbers], dtype=torch.float64)
        if len(table) != 4 * int(count):
            raise ReadError(f"{path} announces {count} balls of four numbers each and holds {len(table)} numbers.")
    table = table.reshape(-1, 4)
    if len(table) == 0 or not bool(table.isfinite().all()) or not bool((table[:, 3] > 0).all()):
        raise ReadError(f"{path}: every line must be x y z and a positive radius, and there must be one.")
    return table[:, :3], table[:, 3]
