"""The object of a scene: what is cut off, what is kept, how it is written, and what its open report says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from plyfile import PlyData
from splat_writers import Scene, torus_scene, write_ply, write_splat, write_spz
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app
from topokit.errors import GenusError, InputError, UnknownFormatError

N_OBJECT = 1500


def splats_of(scene: Scene) -> tk.GaussianSplats:
    return tk.GaussianSplats(*(torch.from_numpy(np.ascontiguousarray(part)) for part in scene))


def sheet(axis: int, offset: float, count: int = 1500) -> Scene:
    """A square of side 6 across an axis."""
    rng = np.random.default_rng(axis)
    means = rng.uniform(-3, 3, size=(count, 3))
    means[:, axis] = offset + rng.normal(size=count) * 0.01
    scales = np.full((count, 3), 0.12)
    scales[:, axis] = 0.004
    return Scene(means, scales, np.tile([1.0, 0, 0, 0], (count, 1)), rng.uniform(0.6, 1, count))


def room() -> Scene:
    """A torus on a table before a wall, with floaters and haze; the torus comes first."""
    torus = torus_scene(N_OBJECT)
    rng = np.random.default_rng(0)
    floaters = torus_scene(30)
    floaters = floaters._replace(means=0.05 * floaters.means + [0, 0, 2.0], scales=0.05 * floaters.scales)
    haze = torus_scene(200)._replace(means=rng.uniform(-3, 3, (200, 3)), opacities=np.full(200, 0.03))
    parts = (torus, sheet(2, -0.4), sheet(1, -2.9), floaters, haze)
    return Scene(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def overlap(rows: torch.Tensor) -> float:
    """Intersection over union with the torus."""
    kept = set(rows.tolist())
    return len(kept & set(range(N_OBJECT))) / len(kept | set(range(N_OBJECT)))


def test_the_object_of_a_room_is_found_and_every_step_can_be_switched_off() -> None:
    splats = splats_of(room())
    kept = splats.object()
    assert len(kept.planes) == 2
    assert overlap(kept.rows) > 0.85  # the table's thickness is cut from the torus, too
    assert [text in " ".join(kept.notes) for text in ("min_opacity", "surroundings", "isolated")] == [True] * 3
    assert torch.equal(splats[kept.rows].means, kept.splats.means)
    with_table = splats.object(surroundings=False)
    assert with_table.planes == ()
    assert len(with_table) > N_OBJECT
    assert len(splats.object(min_opacity=None, component="all", min_cluster_share=None)) > len(kept)


def test_a_plate_that_lies_on_the_table_is_no_table() -> None:
    plate = sheet(2, 0.2)
    plate = plate._replace(means=plate.means * [0.3, 0.3, 1.0], scales=0.3 * plate.scales)
    knob = torus_scene(60)
    knob = knob._replace(means=0.05 * knob.means + [0, 0, 0.3], scales=0.05 * knob.scales)
    scene = Scene(*(np.concatenate(columns) for columns in zip(plate, knob, sheet(2, 0.0), strict=True)))
    kept = splats_of(scene).object()
    assert len(kept.planes) == 1
    assert int((kept.rows < 1500).sum()) > 1400


def test_a_floater_as_wide_as_the_resolution_makes_the_answer_unsure() -> None:
    def report_with(size: float, **options: Any) -> tk.TopologyReport:
        one = torus_scene(40)
        one = one._replace(means=size * one.means + [4.0, 0, 0], scales=size * one.scales)
        scene = Scene(*(np.concatenate(columns) for columns in zip(torus_scene(3_000), one, strict=True)))
        return tk.from_splats(splats_of(scene), **options).report()

    narrow, wide = report_with(0.01), report_with(0.09)
    assert (narrow.euler, narrow.verdict) == (0, "likely")
    assert (wide.euler, wide.verdict, wide.n_deciding) == (0, "unsure", 1)
    assert wide.reasons[0].startswith("A cluster 0.2")
    assert "min_cluster_share=None counts it" in wide.reasons[0]
    assert report_with(0.09, component="largest").verdict == "likely"
    assert report_with(0.09, object=True).verdict == "likely"


def test_a_closed_object_without_surroundings_is_kept_whole() -> None:
    assert len(splats_of(torus_scene(800)).object()) == 800


@pytest.mark.parametrize("n_splats", [1, 3, 40])
def test_few_splats_have_no_surroundings(n_splats: int) -> None:
    assert splats_of(sheet(2, 0.0, n_splats)).object(component="all", min_cluster_share=None).planes == ()


def test_splats_in_one_place_have_no_surroundings() -> None:
    scene = sheet(2, 0.0, 300)
    assert splats_of(scene._replace(means=np.zeros((300, 3)))).object().planes == ()


def test_linked_rings_are_one_object() -> None:
    ring = torus_scene(1200, minor=0.2)
    other = ring._replace(means=ring.means[:, [2, 1, 0]] + [0, 1.0, 0])  # around the tube of the first
    beside = ring._replace(means=ring.means + np.array([4.0, 0, 0]))
    scene = Scene(*(np.concatenate(columns) for columns in zip(ring, other, beside, strict=True)))
    kept = splats_of(scene).object(surroundings=False)
    assert torch.equal(kept.rows, torch.arange(2400))
    assert "component='middle'" in kept.notes[-1]


def test_the_middle_object_is_differentiable() -> None:
    scene = room()
    means = torch.from_numpy(scene.means).requires_grad_()
    rest = (torch.from_numpy(np.ascontiguousarray(part)) for part in scene[1:])
    kept = tk.GaussianSplats(means, *rest).object()
    kept.splats.means.sum().backward()
    assert means.grad is not None
    assert torch.equal(means.grad[:, 0].nonzero().squeeze(1), kept.rows)


def written(path: Path, scene: Scene) -> NDArray[np.int64]:
    rows = np.array([4, 7, 11, 400])
    if path.suffix == ".spz":
        write_spz(path, scene, 3)
    else:
        {".ply": write_ply, ".splat": write_splat}[path.suffix](path, scene)
    return rows


@pytest.mark.parametrize("suffix", [".ply", ".splat", ".spz"])
def test_kept_splats_are_written_as_they_are_in_the_file(suffix: str, tmp_path: Path) -> None:
    path, target = tmp_path / f"scene{suffix}", tmp_path / f"object{suffix}"
    rows = written(path, torus_scene(500))
    scene = tk.GaussianSplats.from_file(path)
    kept = scene.object()
    kept.chosen(torch.isin(kept.rows, torch.from_numpy(rows))).save(target, like=path)
    read = tk.GaussianSplats.from_file(target)
    for name in ("means", "scales", "quaternions", "opacities"):
        assert torch.equal(getattr(read, name), getattr(scene, name)[rows]), name
    if suffix == ".ply":  # with columns that are not read
        before, after = (PlyData.read(file)["vertex"].data for file in (path, target))
        assert np.array_equal(before[rows], after)


def test_what_cannot_be_taken_apart_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    write_ply(path, torus_scene(500))
    kept = tk.GaussianSplats.from_file(path).object()
    with pytest.raises(InputError, match=r"must end with \.ply"):
        kept.save(tmp_path / "object.splat", like=path)
    packed = tmp_path / "scene.ksplat"
    packed.write_bytes(b"\0\1" + bytes(5000))
    with pytest.raises(UnknownFormatError, match="cannot be written as they are"):
        kept.save(tmp_path / "object.ksplat", like=packed)


def test_the_command_writes_the_object_and_reports_it(tmp_path: Path) -> None:
    path, target = tmp_path / "room.ply", tmp_path / "object.ply"
    write_ply(path, room())
    page = tmp_path / "object.html"
    done = CliRunner().invoke(app, ["clean", str(path), "--object", "-o", str(target), "--html", str(page)])
    assert done.exit_code == 0, done.output
    text = page.read_text(encoding="utf-8")
    assert "splats lie on or behind a plane" in text
    assert text.count('id="scene-') == 1
    assert "splats lie on or behind a plane" in done.stderr
    n_kept = len(tk.GaussianSplats.from_file(target))
    assert 0.85 * N_OBJECT < n_kept < N_OBJECT
    assert f"{n_kept} of " in done.stdout
    wrong = CliRunner().invoke(app, ["clean", str(path), "--samples", "50", "-o", str(target)])
    assert wrong.exit_code == 1
    assert "n_samples" in wrong.stderr


def test_a_rim_is_closed_by_the_cap_and_said() -> None:
    scene = torus_scene(3000)
    above = scene.means[:, 2] > -0.3
    shape = tk.from_splats(splats_of(Scene(*(part[above] for part in scene))))
    report = shape.report()
    assert (report.verdict, report.closed, report.genus) == ("unsure", False, 1)  # its underside is a ring
    assert (report.euler, report.boundary_loops, len(report.rim_widths)) == (0, 2, 2)
    assert "genus 1 after closing 2 rims" in str(report)
    assert shape.genus() == shape.genus(cap=report.rim_widths[0]) == 1
    with pytest.raises(GenusError, match="not closed"):
        shape.genus(cap=False)
    with pytest.raises(GenusError, match=r"wider than cap=0\.1"):
        shape.genus(cap=0.1)
