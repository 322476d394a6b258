"""Volumes: exact numbers under both connectivities, walls and cavities, files, and a gradient in the gray values."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import topokit as tk


def torus_volume(shape: tuple[int, int, int] = (48, 48, 24)) -> torch.Tensor:
    """Gray values, positive inside, over [−1, 1]² × [−½, ½]."""
    axes = [torch.linspace(-side, side, n, dtype=torch.float64) for side, n in zip((1, 1, 0.5), shape, strict=True)]
    x, y, z = torch.meshgrid(*axes, indexing="ij")
    return 0.25 - torch.hypot(torch.hypot(x, y) - 0.6, z)


def two_corners() -> np.ndarray:
    """Two voxels that share a corner: one part or two, as the connectivity goes."""
    volume = np.zeros((4, 4, 4), dtype=bool)
    volume[1, 1, 1] = volume[2, 2, 2] = True
    return volume


@pytest.mark.parametrize(("connectivity", "euler", "components"), [(26, 2, 1), (6, 4, 2)])
def test_connectivity_is_honored_and_stated(connectivity: int, euler: int, components: int) -> None:
    report = tk.from_voxels(two_corners(), connectivity=connectivity).report()
    assert (report.euler, report.components, report.verdict) == (euler, components, "certain")
    assert f"{connectivity}-connected foreground" in report.reasons[0]
    assert "ambiguous" in report.reasons[1]


@pytest.mark.parametrize(
    "volume",
    [
        torus_volume() > 0,
        (torus_volume() > 0).to(torch.uint8) * 255,
        (torus_volume() > 0).float(),
        (torus_volume() > 0).numpy().astype(">u2") * 3,
        np.asfortranarray((torus_volume() > 0).numpy())[::-1],
        (torus_volume() > 0).long().tolist(),
    ],
)
def test_binary_volumes_of_any_type_need_no_level(volume: Any) -> None:
    report = tk.from_voxels(volume, spacing=(1, 1, 2)).report()
    assert (report.euler, report.genus, report.verdict) == (0, 1, "certain")
    assert report.resolution is None


def test_the_origin_moves_samples_boxes_and_the_field() -> None:
    volume = torus_volume() > 0
    spacing, origin = (0.5, 1.0, 2.0), (100.0, -3.0, 7.5)
    here = tk.from_voxels(volume, spacing=spacing, n_samples=500)
    there = tk.from_voxels(volume, spacing=spacing, origin=origin, n_samples=500)
    shift = torch.tensor(origin, dtype=torch.float64)
    torch.testing.assert_close(there.samples.points, here.samples.points + shift)
    assert torch.equal(there.samples.normals, here.samples.normals)
    for corner, moved in zip(
        here.report().per_component[0].bounds, there.report().per_component[0].bounds, strict=True
    ):
        np.testing.assert_allclose(moved, np.add(corner, origin))
    assert (there.field.grid.origin, there.field.grid.spacing) == (origin, spacing)


def test_gray_and_labeled_volumes() -> None:
    gray = torus_volume()
    assert tk.from_voxels(gray, level=0.0).genus() == 1
    labels = (gray > 0).int() * 5 + (gray < -0.4).int() * 9
    assert tk.from_voxels(labels, label=5).genus() == 1
    assert tk.from_voxels(labels, label=5).report().reasons[1] == "The solid is the voxels with label 5."


def test_nesting_of_a_ball_in_a_shell() -> None:
    x = torch.stack(torch.meshgrid(*[torch.linspace(-1, 1, 41)] * 3, indexing="ij")).norm(dim=0)
    report = tk.from_voxels((x < 0.3) | ((x > 0.5) & (x < 0.8)), spacing=0.05).report()
    assert (report.euler, report.components, report.cavities, report.surface_betti) == (6, 3, 1, (3, 0, 3))
    outer, wall, inner = report.per_component
    assert (outer.depth, wall.depth, inner.depth) == (0, 1, 2)
    assert (outer.inside, wall.inside, inner.inside) == (None, 0, 1)
    assert outer.bounds[0][0] == pytest.approx(0.05 * 5 - 0.025)


def test_tunnel_is_found_in_the_component_that_has_it() -> None:
    volume = np.zeros((30, 30, 30), dtype=bool)
    volume[2:10, 2:10, 2:10] = True
    volume[15:25, 15:25, 15:18] = True
    volume[18:21, 18:21] = False
    parts = tk.from_voxels(volume, connectivity=6).report().per_component
    assert {part.bounds[0]: part.genus for part in parts} == {(1.5,) * 3: 0, (14.5,) * 3: 1}


def test_border_contact_is_said() -> None:
    volume = np.zeros((6, 6, 6), dtype=bool)
    volume[:, 2:4, 2:4] = True
    report = tk.from_voxels(volume).report()
    assert (report.euler, report.verdict) == (2, "certain")
    assert any("first layer along axis 0, last layer along axis 0" in reason for reason in report.reasons)
    assert not any("axis 1" in reason for reason in report.reasons)


def test_gradient_reaches_the_gray_values() -> None:
    gray = torus_volume((8, 8, 6)) + 0.01 * torch.rand(8, 8, 6, generator=torch.Generator().manual_seed(0)).double()
    gray.requires_grad_(True)

    def euler(volume: torch.Tensor) -> torch.Tensor:
        return tk.from_voxels(volume, level=0.01, connectivity=26).smoothed_euler(0.05)

    assert torch.autograd.gradcheck(euler, (gray,))


def test_gradient_wants_the_tunnel_filled() -> None:
    """Raising χ of a block with a shallow tunnel means raising the tunnel's voxels, and no others."""
    gray = torch.full((12, 12, 7), -1.0, dtype=torch.float64)
    gray[2:10, 2:10, 1:6] = 1.0
    tunnel = (slice(5, 7), slice(5, 7), slice(1, 6))
    gray[tunnel] = -0.2
    gray.requires_grad_(True)
    tk.from_voxels(gray, level=0.0).smoothed_euler(0.05).backward()
    assert float(gray.grad[tunnel].sum()) > 0.1
    outside = gray.grad.clone()
    outside[tunnel] = 0
    assert float(outside.abs().max()) < 1e-3 * float(gray.grad[tunnel].abs().max())


def test_tau_zero_is_the_exact_integer() -> None:
    for kind in (torus_volume() > 0, torus_volume(), (torus_volume() > 0).int() * 4):
        shape = tk.from_voxels(kind, level=0.0)
        value = shape.smoothed_euler(0)
        assert int(value) == shape.report().euler == 0


def test_curvature_of_a_ball() -> None:
    across, along = torch.arange(-16.0, 17.0).double(), 2 * torch.arange(-8.0, 9.0).double()
    x = torch.stack(torch.meshgrid(across, across, along, indexing="ij"))
    shape = tk.from_voxels(x.norm(dim=0) < 12, spacing=(1, 1, 2))
    centered = shape.samples.points - 16
    assert float((centered.norm(dim=1) - 12).abs().mean()) < 0.3
    assert float((shape.samples.normals * centered).sum(1).min()) > 0
    assert float(shape.curvature().mean.median()) == pytest.approx(1 / 12, rel=0.1)
    assert float(shape.gauss_bonnet()) == pytest.approx(2, abs=0.3)


def test_smooth_samples_lie_on_the_surface_in_any_spacing() -> None:
    """A distance on a grid of oblong voxels; the spline bends with it, so the samples are on the sphere."""
    spacing = (0.05, 0.04, 0.1)
    axes = [step * torch.arange(-n, n + 1) for step, n in zip(spacing, (24, 30, 12), strict=True)]
    x = torch.stack(torch.meshgrid(*axes, indexing="ij"))
    shape = tk.from_voxels(0.8 - x.norm(dim=0), level=0.0, spacing=spacing, origin=[float(axis[0]) for axis in axes])
    radii = shape.samples.points.norm(dim=1)
    assert float((radii - 0.8).abs().max()) < 0.02  # smoothing by one voxel moves the surface inward by about σ²/r
    outward = (shape.samples.normals * shape.samples.points).sum(1) / radii
    assert float(outward.min()) > 0.999


def test_samples_do_not_depend_on_when_they_are_drawn() -> None:
    def shapes() -> tuple[tk.Shape, tk.Shape, torch.Generator]:
        generator = torch.Generator().manual_seed(3)
        one, other = (tk.from_voxels(torus_volume() > 0, n_samples=500, generator=generator) for _ in range(2))
        return one, other, generator

    first, second, _ = shapes()
    late_first, late_second, generator = shapes()
    torch.rand(7, generator=generator)
    late_second.samples  # noqa: B018
    assert torch.equal(first.samples.points, late_first.samples.points)
    assert torch.equal(second.samples.points, late_second.samples.points)
    assert not torch.equal(first.samples.points, second.samples.points)


def test_thin_solids_are_sampled_as_they_are() -> None:
    volume = np.zeros((20, 20, 20), dtype=bool)
    volume[10, 2:18, 10] = True
    shape = tk.from_voxels(volume)
    assert shape.report().euler == 2
    assert shape.samples.n_points == 10_000


@pytest.mark.parametrize(("around", "inside"), [(-1e-30, 1.0), (-1.0, 1e30), (0.0, np.inf)])
def test_values_inside_may_be_far_larger_than_those_around(around: float, inside: float) -> None:
    volume = np.full((9, 9, 9), around)
    volume[3:6, 3:6, 3:6] = inside
    samples = tk.from_voxels(volume, level=0.0, n_samples=200).samples
    distance = (samples.points - 4).abs().amax(1)  # from the middle of a cube whose faces are 1.5 away
    assert float(distance.min()) > 0.9
    assert float(distance.max()) < 3.0
    assert torch.isfinite(samples.normals).all()


@pytest.mark.parametrize(
    ("volume", "options", "said"),
    [
        (np.zeros((40, 48)), {}, r"got \(40, 48\)\. .*image\[None\]"),
        (np.zeros((2, 4, 4, 4)), {}, r"got \(2, 4, 4, 4\)\. Of several"),
        (np.zeros((3, 3)), {}, r"shape \(X, Y, Z\)"),
        (np.zeros((3, 3, 3)), {}, "no voxel is above"),
        (np.ones((3, 3, 3)), {"label": 2}, "equals the label 2"),
        (np.arange(27).reshape(3, 3, 3), {}, "pass level="),
        (np.ones((3, 3, 3), dtype=complex), {}, "real numbers"),
        (np.ones((3, 3, 3)), {"connectivity": 18}, r"^connectivity must be 6 or 26, not 18\."),
        (np.ones((3, 3, 3)), {"spacing": (1, 0, 1)}, "positive"),
        (np.ones((3, 3, 3)), {"spacing": (1, 1)}, "one number or three"),
        (np.ones((3, 3, 3)), {"origin": (1, 2)}, r"origin must be three numbers, got \(1, 2\)"),
        (np.ones((3, 3, 3)), {"origin": (1, 2, np.inf)}, "origin must be finite"),
        (np.ones((3, 3, 3)), {"label": 1, "level": 0.5}, "both"),
        (np.ones((3, 3, 3)), {"label": [1, "bone"]}, "^each label must be one number, got 'bone'"),
        (np.ones((3, 3, 3)), {"label": []}, "^label is empty; expected one label or several"),
        (np.ones((3, 3, 3)), {"label": torch.ones(2, 2)}, "^each label must be one number"),
        (np.ones((3, 3, 3)), {"level": "half"}, "^level must be one number, got 'half'"),
        (np.full((3, 3, 3), np.nan), {}, "NaN"),
        (np.ones((0, 3, 3)), {}, "shape"),
        (np.ones((3, 3, 3)), {"n_samples": 5}, "^n_samples is 5; it must be larger than n_neighbors"),
    ],
)
def test_each_failure_has_its_own_message(volume: np.ndarray, options: dict[str, Any], said: str) -> None:
    with pytest.raises(tk.TopokitError, match=said):
        tk.from_voxels(volume, **options)


def test_nan_is_background_and_said() -> None:
    gray = torus_volume()
    gray[0, 0, 0] = torch.nan
    shape = tk.from_voxels(gray, level=0.0)
    assert shape.report().euler == 0
    assert "NaN counts as background, in 1 voxel." in shape.report().reasons
    assert float(shape.smoothed_euler(0.02)) == pytest.approx(0, abs=0.1)


# files


def write_nifti(path: Path, volume: np.ndarray) -> None:
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.Nifti1Image(volume, np.diag([1.0, 1.0, 2.0, 1.0])), path)


def write_nrrd(path: Path, volume: np.ndarray) -> None:
    pytest.importorskip("nrrd").write(str(path), volume, {"spacings": [1.0, 1.0, 2.0]})


def write_tiff(path: Path, volume: np.ndarray) -> None:
    pytest.importorskip("tifffile").imwrite(path, volume)


WRITERS: dict[str, Callable[[Path, np.ndarray], None]] = {
    "torus.npy": np.save,
    "torus.npz": lambda path, volume: np.savez(path, vol=volume, spacing=[1.0, 1.0, 2.0]),
    "torus.nii": write_nifti,
    "torus.nii.gz": write_nifti,
    "torus.nrrd": write_nrrd,
    "torus.tif": write_tiff,
}


@pytest.mark.parametrize("name", WRITERS)
def test_files_by_content(tmp_path: Path, name: str) -> None:
    WRITERS[name](tmp_path / name, (torus_volume() > 0).numpy().astype(np.uint8))
    shape = tk.load(tmp_path / name)
    assert (shape.report().euler, shape.name) == (0, name)
    spaced = name.endswith((".npz", ".nii", ".nii.gz", ".nrrd"))
    assert shape.field.grid.spacing == (1.0, 1.0, 2.0 if spaced else 1.0)


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "torus.npy"])
def test_truncated_files_are_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    WRITERS[name](path, (torus_volume() > 0).numpy().astype(np.uint8))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(tk.TopokitError):
        tk.load(path)


def test_an_array_of_points_stays_points(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(200, 3))
    np.save(tmp_path / "cloud.npy", points)
    np.savez(tmp_path / "cloud.npz", points=points)
    for name in ("cloud.npy", "cloud.npz"):
        assert tk.load(tmp_path / name).field is None


@pytest.mark.long
def test_real_volumes(real_data: Path) -> None:
    """Every volume of the shared data that has a truth, under both connectivities."""
    index = json.loads((real_data / "index.json").read_text(encoding="utf-8"))
    rows = [row for row in index if row["kind"] == "voxels" and "solid_chi_26" in row]
    assert rows
    for row in rows:
        for connectivity in (26, 6):
            shape = tk.from_voxels(real_data / row["path"], connectivity=connectivity)
            assert int(shape.smoothed_euler(0)) == 2 * row[f"solid_chi_{connectivity}"], row["name"]
