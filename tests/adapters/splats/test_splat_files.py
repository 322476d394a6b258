"""Every splat format, read back from what the writers of these tests wrote, and the real files where they are."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest
import torch
from splat_writers import WRITERS, Scene, random_scene, write_compressed_ply, write_ply, write_spz

import topokit as tk
from topokit.errors import ReadError, UnknownFormatError

# Half a step of each format: means as a share of the scene's side, scales as a factor, rotation as an angle.
MEANS = {"3dgs": 1e-6, "splat": 1e-6, "compressed": 6e-4, "spz": 4e-5, "spz-1": 3e-4, "sog": 4e-5, "ksplat": 2e-5}
SCALES = {"3dgs": 1e-5, "splat": 1e-6, "compressed": 5e-3, "spz": 0.035, "sog": 0.02, "ksplat": 1e-3}
ANGLES = {"3dgs": 1e-3, "splat": 0.02, "compressed": 4e-3, "spz": 6e-3, "spz-1": 0.2, "spz-2": 0.2, "sog": 0.02}


def tolerance(table: dict[str, float], format_name: str, default: float | None = None) -> float:
    exact = {key: value for key, value in table.items() if format_name.startswith(key)}
    return exact[max(exact, key=len)] if exact else default if default is not None else 1e-3


def angles(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    cosine = (first.double() * second.double()).sum(-1).abs().clamp(max=1)
    return 2 * torch.arccos(cosine)


def agree(splats: tk.GaussianSplats, scene: Scene, format_name: str) -> None:
    """Means, scales, rotations and opacities agree with the scene within the format's quantization."""
    side = np.ptp(scene.means, axis=0).max()
    assert len(splats) == len(scene.means)
    assert np.abs(splats.means.numpy() - scene.means).max() <= tolerance(MEANS, format_name) * side
    factor = np.abs(np.log(splats.scales.double().numpy() / scene.scales)).max()
    assert factor <= tolerance(SCALES, format_name)
    turned = angles(splats.quaternions, torch.from_numpy(scene.quaternions))
    assert float(turned.max()) <= tolerance(ANGLES, format_name, 3e-3)
    assert np.abs(splats.opacities.numpy() - scene.opacities).max() <= 0.5 / 255 + 1e-6
    assert torch.allclose(splats.quaternions.norm(dim=-1), torch.ones(len(splats)), atol=1e-6)


@pytest.mark.parametrize("format_name", WRITERS)
def test_reads_what_was_written(format_name: str, tmp_path: Path) -> None:
    scene = random_scene(300)
    name, write = WRITERS[format_name]
    write(tmp_path / name, scene)
    agree(tk.GaussianSplats.from_file(tmp_path / name), scene, format_name)


@pytest.mark.parametrize("format_name", [name for name in WRITERS if name not in ("splat", "sog-folder")])
def test_content_comes_before_the_suffix(format_name: str, tmp_path: Path) -> None:
    scene = random_scene(40)
    path = tmp_path / "scene.splat"
    WRITERS[format_name][1](path, scene)
    agree(tk.GaussianSplats.from_file(path), scene, format_name)


def test_round_trip_through_ply(tmp_path: Path) -> None:
    scene = random_scene(500)
    write_ply(tmp_path / "scene.ply", scene)
    splats = tk.GaussianSplats.from_file(tmp_path / "scene.ply")
    splats.to_ply(tmp_path / "again.ply")
    again = tk.GaussianSplats.from_file(tmp_path / "again.ply")
    assert torch.equal(splats.means, again.means)
    torch.testing.assert_close(splats.scales, again.scales, rtol=1e-6, atol=0)
    torch.testing.assert_close(splats.opacities, again.opacities, rtol=0, atol=2e-7)
    torch.testing.assert_close(splats.quaternions, again.quaternions, rtol=0, atol=1e-6)


def test_round_trip_keeps_the_ends_finite(tmp_path: Path) -> None:
    means = torch.zeros(3, 3)
    splats = tk.GaussianSplats(
        means, torch.tensor([[1.0, 1.0, 0.0]] * 3), torch.eye(4)[:3], torch.tensor([0.0, 0.5, 1])
    )
    splats.to_ply(tmp_path / "ends.ply")
    again = tk.GaussianSplats.from_file(tmp_path / "ends.ply")
    assert bool(torch.isfinite(again.scales).all())
    torch.testing.assert_close(again.scales, splats.scales, rtol=1e-6, atol=1e-30)
    torch.testing.assert_close(again.opacities, splats.opacities, rtol=0, atol=1e-6)


def test_to_ply_refuses_a_missing_folder_and_another_suffix(tmp_path: Path) -> None:
    splats = tk.GaussianSplats(torch.zeros(1, 3), torch.ones(1, 3), torch.ones(1, 4), torch.ones(1))
    with pytest.raises(tk.TopokitError, match=r"the folder of .*scene\.ply does not exist: create it first"):
        splats.to_ply(tmp_path / "nowhere" / "scene.ply")
    with pytest.raises(tk.TopokitError, match=r"scene\.splat does not end with \.ply"):
        splats.to_ply(tmp_path / "scene.splat")
    with pytest.raises(tk.TopokitError, match="no splat to write"):
        splats[:0].to_ply(tmp_path / "scene.ply")


def test_two_dimensional_gaussians_have_a_third_scale_of_zero(tmp_path: Path) -> None:
    scene = random_scene(100)
    write_ply(tmp_path / "scene.ply", scene, n_scales=2)
    splats = tk.GaussianSplats.from_file(tmp_path / "scene.ply")
    assert bool((splats.scales[:, 2] == 0).all())
    torch.testing.assert_close(splats.scales[:, :2].double(), torch.from_numpy(scene.scales[:, :2]), rtol=1e-5, atol=0)


@pytest.mark.parametrize("style", ["binary_little_endian", "binary_big_endian", "ascii"])
def test_half_floats_are_read(style: str, tmp_path: Path) -> None:
    scene = random_scene(100)
    write_ply(tmp_path / "scene.ply", scene, kind="half", style=style)
    splats = tk.GaussianSplats.from_file(tmp_path / "scene.ply")
    assert np.abs(splats.means.numpy() - scene.means).max() < 2e-3


def test_comments_and_line_ends_of_any_kind_are_read(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    write_ply(path, random_scene(30))
    header, _, body = path.read_bytes().partition(b"end_header\n")
    path.write_bytes(header.replace(b"made by a test", "café, 東京".encode()) + b"end_header\n" + body)
    agree(tk.GaussianSplats.from_file(path), random_scene(30), "3dgs")
    path.write_bytes(header.replace(b"\n", b"\r\n") + b"end_header\r\n" + body)
    agree(tk.GaussianSplats.from_file(path), random_scene(30), "3dgs")


def test_compressed_ply_with_properties_of_another_type_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    write_compressed_ply(path, random_scene(30))
    path.write_bytes(path.read_bytes().replace(b"property uint packed_scale", b"property float packed_scale"))
    with pytest.raises(ReadError, match=r"element 'vertex' of a compressed \.ply must have rows of .*each uint"):
        tk.GaussianSplats.from_file(path)


def test_other_elements_may_come_before_the_splats(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    write_ply(path, random_scene(10))
    content = path.read_bytes()
    for declared, row in ((b"property float f", b"abcd"), (b"property list uchar short f", b"\x02abcd")):
        header, _, body = content.partition(b"end_header\n")
        header = header.replace(b"element vertex", b"element camera 1\n" + declared + b"\nelement vertex")
        path.write_bytes(header + b"end_header\n" + row + body)
        agree(tk.GaussianSplats.from_file(path), random_scene(10), "3dgs")


def test_spz_of_another_version_is_refused_with_a_converter(tmp_path: Path) -> None:
    write_spz(tmp_path / "scene.spz", random_scene(5), 2, zipped=False)
    content = bytearray((tmp_path / "scene.spz").read_bytes())
    content[4] = 9
    (tmp_path / "scene.spz").write_bytes(content)
    with pytest.raises(ReadError, match=r"is \.spz version 9; versions 1 to 4 are known\. PlayCanvas splat-transform"):
        tk.GaussianSplats.from_file(tmp_path / "scene.spz")


@pytest.mark.parametrize("format_name", WRITERS)
def test_truncated_files_are_refused(format_name: str, tmp_path: Path) -> None:
    name, write = WRITERS[format_name]
    write(tmp_path / name, random_scene(300))
    path = tmp_path / name
    victim = path / "quats.webp" if path.is_dir() else path
    content = victim.read_bytes()
    victim.write_bytes(content[: len(content) - 33])
    with pytest.raises(tk.TopokitError, match=victim.stem.partition(".")[0]):
        tk.GaussianSplats.from_file(path)


@pytest.mark.parametrize("name", ["scene.lcc", "scene", "scene.ply"])
def test_what_is_no_splat_file_is_refused_by_name(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"ply\nformat ascii 1.0\nend_header\n" if name.endswith("ply") else b"something else")
    with pytest.raises(UnknownFormatError, match=r"from_mesh|splat-transform"):
        tk.GaussianSplats.from_file(tmp_path / name)


def test_a_bomb_is_refused_before_it_expands(tmp_path: Path) -> None:
    header = struct.pack("<4sIIBBBB", b"NGSP", 2, 2**31, 0, 12, 0, 0)
    path = tmp_path / "scene.spz"
    path.write_bytes(gzip.compress(header + bytes(1 << 20)))
    with pytest.raises(ReadError, match=r"announces content of \d+ bytes.*or it is a decompression bomb"):
        tk.GaussianSplats.from_file(path)
    path.write_bytes(gzip.compress(header[:8] + struct.pack("<I", 100) + header[12:] + bytes(100)))
    with pytest.raises(ReadError, match=r"announces 100 splats, which takes at least \d+ bytes, but has 100 bytes"):
        tk.GaussianSplats.from_file(path)


def test_every_real_file_loads(real_data: Path) -> None:
    files = sorted((real_data / "splats").iterdir())
    assert len(files) >= 20
    for path in files:
        shape = tk.load(path, n_samples=2000)
        assert shape.samples.n_points == 2000, path
        assert any("samples lie on the discs" in note for note in shape.notes), path


@pytest.mark.parametrize(
    ("coarse", "fine", "mean_step"),
    [
        ("playbot_lod_3_0", "converted_playbot_lod_3_0.ply", 1e-6),
        ("playbot_lod_4_0", "converted_playbot_lod_4_0.ply", 1e-6),
        ("statue_angel.sog", "converted_statue_angel.ply", 1e-6),
        ("converted_statue_angel.splat", "converted_statue_angel.ply", 1e-6),
        ("metalsplatter_3pts_from_train.splat", "metalsplatter_3pts_from_train.ply", 1e-6),
        ("metalsplatter_3pts_from_train.spz", "metalsplatter_3pts_from_train.ply", 0.5 / 4096 + 1e-6),
        ("fixture_minimal.ksplat", "fixture_minimal.splat", 1e-6),
        ("fixture_minimal-v3.spz", "fixture_minimal.splat", 0.5 / 4096),
        ("fixture_minimal-v4.spz", "fixture_minimal.splat", 0.5 / 4096),
    ],
)
def test_one_scene_in_two_formats_agrees(coarse: str, fine: str, mean_step: float, real_data: Path) -> None:
    first, second = (tk.GaussianSplats.from_file(real_data / "splats" / name) for name in (coarse, fine))
    assert len(first) == len(second)
    rows = _same_order(first, second)
    assert float((first.means[rows] - second.means).abs().max()) <= mean_step
    assert float((first.opacities[rows] - second.opacities).abs().max()) <= 1 / 255
    ratio = (first.scales[rows] / second.scales).log().abs().max()
    assert float(ratio) <= (0.035 if coarse.endswith(".spz") else 1e-4)
    if not coarse.startswith("fixture"):  # those Gaussians are round, and their rotations are not the same
        assert float(angles(first.quaternions[rows], second.quaternions).max()) < 0.03


def _same_order(first: tk.GaussianSplats, second: tk.GaussianSplats) -> torch.Tensor:
    """Rows of the first scene in the order of the second: converters sort splats anew."""
    if torch.allclose(first.means, second.means, atol=1e-3):
        return torch.arange(len(first))
    keys = [np.lexsort(splats.means.numpy().round(5).T) for splats in (first, second)]
    rows = np.empty(len(first), dtype=np.int64)
    rows[keys[1]] = keys[0]
    return torch.from_numpy(rows)
