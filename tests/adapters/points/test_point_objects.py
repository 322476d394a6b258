"""Clouds of other libraries, data frames and .e57 files."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.errors import InputError
from topokit.testing import sphere_samples

KNOWN = sphere_samples(120)
POINTS, NORMALS = KNOWN.points.numpy(), KNOWN.normals.numpy()


class Frame:
    """The part of a data frame of pandas or polars that is used."""

    def __init__(self, columns: dict[str, Any]) -> None:
        self.iloc, self._columns, self.columns = None, columns, list(columns)

    def __getitem__(self, name: str) -> Any:
        return self._columns[name]


def columns(names: str, values: np.ndarray) -> dict[str, Any]:
    return dict(zip(names.split(), values.T, strict=True))


@pytest.mark.parametrize(
    ("frame", "has_normals"),
    [
        (Frame(columns("x y z", POINTS)), False),
        (Frame(columns("a b c", POINTS)), False),
        (Frame({"intensity": POINTS[:, 0], **columns("Z Y X", POINTS[:, ::-1])}), False),
        (Frame({**columns("nx ny nz", NORMALS), **columns("x y z", POINTS)}), True),
    ],
)
def test_data_frames(frame: Frame, has_normals: bool) -> None:
    samples = tk.from_points(frame).samples
    np.testing.assert_array_equal(samples.points.numpy(), POINTS)
    assert (samples.normals is not None) == has_normals


def test_data_frames_without_coordinates_are_refused() -> None:
    with pytest.raises(InputError, match="the data frame has the columns a, b; x, y and z were expected, or three"):
        tk.from_points(Frame({"a": POINTS[:, 0], "b": POINTS[:, 1]}))


def test_a_frame_of_pandas() -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    assert tk.load(pandas.DataFrame(POINTS, columns=list("xyz"))).samples.n_points == 120


def test_clouds_of_pytorch3d_pyvista_and_vedo() -> None:
    tensors = [KNOWN.points.clone().requires_grad_()]
    clouds = {
        "PyTorch3D": SimpleNamespace(points_list=lambda: tensors, normals_list=lambda: [KNOWN.normals]),
        "PyVista": SimpleNamespace(points=POINTS, point_data={"Normals": NORMALS}),
        "vedo": SimpleNamespace(vertices=POINTS),
    }
    for name, cloud in clouds.items():
        samples = tk.from_points(cloud).samples
        assert torch.equal(samples.points.detach(), KNOWN.points), name
        assert (samples.normals is not None) == (name != "vedo")
    tk.from_points(clouds["PyTorch3D"]).gauss_bonnet().backward()
    assert tensors[0].grad is not None
    two = SimpleNamespace(points_list=lambda: [1, 2], normals_list=lambda: None)
    with pytest.raises(InputError, match="the batch holds 2 clouds"):
        tk.from_points(two)


def test_scans_of_an_e57_file_are_put_together(tmp_path: Path) -> None:
    pye57 = pytest.importorskip("pye57", reason="pye57 is not installed; make test installs it")
    file = pye57.E57(str(tmp_path / "a.e57"), mode="w")
    for part, shift in ((POINTS[:70], 2.0), (POINTS[70:], 0.0)):
        scan = {f"cartesian{axis}": part[:, column] for column, axis in enumerate("XYZ")}
        file.write_scan_raw(scan, translation=np.array([shift, 0, 0]))
    file.close()
    found = tk.load(tmp_path / "a.e57").samples.points.numpy()
    np.testing.assert_allclose(found[:70], POINTS[:70] + np.array([2, 0, 0]), atol=1e-6)
    np.testing.assert_allclose(found[70:], POINTS[70:], atol=1e-6)
    content = (tmp_path / "a.e57").read_bytes()
    for damaged in (content[:-500], content[:1000], content[:60] + bytes(200) + content[260:]):
        (tmp_path / "b.e57").write_bytes(damaged)
        with pytest.raises(tk.TopokitError):
            tk.load(tmp_path / "b.e57")
