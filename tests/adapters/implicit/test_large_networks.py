"""Networks on fine grids: block by block, here and on a Dask cluster, the report is the same."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

import topokit as tk
from topokit.adapters.implicit import surface
from topokit.adapters.implicit.function import LevelFunction
from topokit.core.implicit import convergence

BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
SIZES: dict[str, Any] = {"bounds": BOX, "resolution": 256, "n_samples": 2000, "field_resolution": 32}


class Torus(nn.Module):
    """A signed distance that can be scripted and pickled."""

    def forward(self, x: Tensor) -> Tensor:
        """The distance (N,) of points (N, 3)."""
        return torch.hypot(torch.hypot(x[:, 0], x[:, 1]) - 0.6, x[:, 2]) - 0.2


def thin_link(x: Tensor) -> Tensor:
    """Two linked tori, whose tubes no grid of 64 cells resolves."""
    one = torch.hypot(torch.hypot(x[:, 0] + 0.25, x[:, 1]) - 0.5, x[:, 2])
    other = torch.hypot(torch.hypot(x[:, 0] - 0.25, x[:, 2]) - 0.5, x[:, 1])
    return torch.minimum(one, other) - 0.02


def test_the_surfaces_of_a_grid_that_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(convergence, "_KEPT_CELLS", 64)
    shape = tk.from_sdf(thin_link, block_voxels=1 << 20, **{**SIZES, "resolution": 512})
    report = shape.report()
    assert (report.euler, report.components, report.solid_betti) == (0, 2, (2, 2, 0))
    assert any("26- or 6-connected) on 64 cells; 0 on 128 cells" in reason for reason in report.reasons)
    assert shape.surface().euler_number == 0


def test_triangles_of_a_grid_beyond_memory_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surface, "_MOST_CELLS", 63)
    with pytest.raises(tk.InputError, match="seen only on a grid of 64 cells, and triangles are made on at most 63"):
        tk.from_sdf(Torus(), **{**SIZES, "resolution": 128}).surface()


def test_block_sizes_are_checked() -> None:
    with pytest.raises(tk.InputError, match="block_voxels must be at least 1, not 0"):
        tk.from_sdf(Torus(), bounds=BOX, block_voxels=0)


@pytest.mark.parametrize("kind", ["module", "script"])
def test_functions_are_sent_to_other_processes(kind: str) -> None:
    points = torch.rand(50, 3)
    net: Any = Torus() if kind == "module" else torch.jit.script(Torus())
    function = LevelFunction(net, 0.1, -1, "net", points)
    sent = pickle.loads(pickle.dumps(function))
    assert torch.equal(sent(points), function(points))
    assert (sent.name, sent.dtype, sent.device) == ("net", function.dtype, function.device)


@pytest.mark.long
def test_workers_count_what_one_process_counts(dask_client: Any, tmp_path: Path) -> None:
    torch.jit.save(torch.jit.script(Torus()), tmp_path / "net.pt")
    sizes = {**SIZES, "resolution": 512}
    expected = tk.from_sdf(Torus(), **sizes).report()
    for source in (tmp_path / "net.pt", lambda x: Torus()(x)):
        found = tk.from_sdf(source, client=dask_client, block_voxels=1 << 20, **sizes).report()
        assert (found.euler, found.verdict, found.per_component) == (
            expected.euler,
            expected.verdict,
            expected.per_component,
        )
        assert found.reasons[1] == expected.reasons[1]  # the counts on all grids
