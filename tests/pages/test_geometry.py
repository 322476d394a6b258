"""What the viewer unpacks is the scene that was packed."""

from __future__ import annotations

import gzip
import json
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import topokit as tk
from topokit.export.scene import Mark, Scene, scene_of
from topokit.pages.fragment import pack
from topokit.testing import sphere_samples, torus_mesh


def unpack(packed: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The reader of web/src/unpack.js in Python."""
    data = gzip.decompress(packed)
    start = 4 + int.from_bytes(data[:4], "little")
    header, arrays = json.loads(data[4:start]), {}
    for name, kind, count in header["arrays"]:
        assert start % 4 == 0
        arrays[name] = np.frombuffer(data, f"<{kind}", count, start)
        start += -(-arrays[name].nbytes // 4) * 4
    assert start == len(data)
    return header, arrays


LEGEND = ("distance", "near", "", "far")


def places(header: dict[str, Any], steps: NDArray[Any]) -> NDArray[np.float64]:
    return np.array(header["low"]) + steps.reshape(-1, 3) / 65535 * header["size"]


def test_a_mesh_comes_back_within_half_a_step() -> None:
    vertices, faces = torus_mesh()
    loop = vertices[:30] + 1000
    scene = scene_of(
        tk.from_mesh((vertices + 1000, faces)),
        (Mark("handle", "handle 1", loop, "loop"), Mark("defect", "pinched", loop[:1], "dots")),
        max_faces=4 * len(faces),
        max_points=100,
    )
    header, arrays = unpack(pack(scene))
    np.testing.assert_allclose(
        places(header, arrays["positions"]), scene.positions, rtol=0, atol=header["size"] / 130000
    )
    np.testing.assert_allclose(places(header, arrays["marks"])[:30], loop, rtol=0, atol=header["size"] / 130000)
    np.testing.assert_array_equal(arrays["faces"].reshape(-1, 3), scene.faces)
    np.testing.assert_allclose(arrays["values"] / 127 * header["limit"], scene.values, atol=header["limit"] / 250)
    assert [line["points"] for line in header["marks"]] == [30, 1]


def test_points_come_back_with_their_normals() -> None:
    known = sphere_samples(500)
    scene = scene_of(tk.from_points(known.points, known.normals), max_faces=100, max_points=1000)
    _, arrays = unpack(pack(scene))
    assert "faces" not in arrays
    np.testing.assert_allclose(arrays["normals"].reshape(-1, 3) / 127, scene.normals, atol=1 / 250)


def test_unknown_curvature_and_large_indices_have_their_own_codes() -> None:
    many = np.random.default_rng(0).random((70_000, 3))
    faces = np.array([[0, 1, 69_999]])
    values = np.where(np.arange(70_000) == 1, np.nan, -5.0)
    _, arrays = unpack(pack(Scene(many, many[:0], values, 1.0, faces, LEGEND)))
    assert arrays["faces"].tolist() == [0, 1, 69_999]
    assert arrays["values"][:3].tolist() == [-127, -128, -127]


@pytest.mark.parametrize("spread", [0.0, 1e-300, 1e200])
def test_any_extent_can_be_packed(spread: float) -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]) * spread
    header, arrays = unpack(pack(Scene(points, points, np.zeros(3), 1.0, None, LEGEND)))
    np.testing.assert_allclose(places(header, arrays["positions"]), points, rtol=1e-4)
