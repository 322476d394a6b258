"""The names that other mesh libraries use: closedness, Betti numbers, size, parts; one-line questions; hints."""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.errors import GenusError, InputError
from topokit.testing import genus_mesh, icosphere, torus_mesh, torus_samples

TORUS_AREA, TORUS_VOLUME = 4 * math.pi**2 * 0.4, 2 * math.pi**2 * 0.4**2


def hollow_ball() -> tk.Shape:
    vertices, faces = icosphere(3)
    return tk.from_mesh(np.concatenate((vertices, vertices / 2)), np.concatenate((faces, faces + len(vertices))))


def test_a_mesh_has_the_words_of_trimesh() -> None:
    shape = tk.from_mesh(torus_mesh(major=1, minor=0.4))
    assert (shape.is_closed, shape.n_components) == (True, 1)
    assert shape.area == pytest.approx(TORUS_AREA, rel=0.01)
    assert shape.volume == pytest.approx(TORUS_VOLUME, rel=0.01)
    assert np.allclose(shape.bounds, ((-1.4, -1.4, -0.4), (1.4, 1.4, 0.4)), atol=0.01)
    assert shape.betti() == ((1, 2, 1), (1, 1, 0))
    assert shape.betti().solid == (1, 1, 0)


def test_sizes_agree_with_trimesh() -> None:
    shape = tk.from_mesh(genus_mesh(2))
    known = shape.to_trimesh()
    assert (shape.area, shape.volume) == pytest.approx((known.area, known.volume))
    assert np.allclose(shape.bounds, known.bounds)


def test_points_have_the_same_words() -> None:
    shape = tk.from_points(torus_samples(2000).points)
    assert (shape.is_closed, shape.n_components, shape.betti().surface) == (True, 1, (1, 2, 1))
    assert shape.area == pytest.approx(TORUS_AREA, rel=0.02)
    assert shape.volume == pytest.approx(TORUS_VOLUME, rel=0.02)
    assert shape.bounds[1][2] == pytest.approx(0.4, abs=0.01)
    assert len(shape.split()) == 1


def test_a_cavity_is_no_volume_and_a_part_of_its_own() -> None:
    shape = hollow_ball()
    outer, inner = shape.split()
    assert shape.betti() == ((2, 0, 2), (1, 0, 1))
    assert shape.volume == pytest.approx(outer.volume * 7 / 8)
    assert inner.volume == pytest.approx(-outer.volume / 8)
    assert [tk.euler(part) for part in (outer, inner)] == [part.euler for part in shape.report().per_component]


def test_an_open_mesh_is_split_and_has_no_volume() -> None:
    vertices, faces = icosphere(2)
    kept = np.concatenate((faces[5:], faces + len(vertices)))
    shape = tk.from_mesh(np.concatenate((vertices, vertices / 3 + 4)), kept)
    assert [part.is_watertight for part in shape.split()] == [False, True]
    with pytest.raises(InputError, match="no closed surface"):
        _ = shape.volume


def test_batches_have_no_single_size() -> None:
    shape = tk.from_points(torch.rand(2, 100, 3, generator=torch.Generator().manual_seed(0)))
    for name in ("bounds", "area"):
        with pytest.raises(InputError, match="batched"):
            getattr(shape, name)


def test_repairs_are_methods_too() -> None:
    shape = tk.from_mesh(torus_mesh(major=1, minor=0.1))
    assert shape.simplify(below=1, components=False).genus() == 0
    vertices, faces = icosphere(2)
    assert tk.from_mesh(vertices, faces[3:]).fill_boundaries().is_closed


def test_one_call_answers_about_a_file(tmp_path: Path) -> None:
    path = tmp_path / "part.off"
    tk.from_mesh(genus_mesh(2)).to_trimesh().export(path)
    assert (tk.euler(path), tk.genus(path), tk.report(path).verdict) == (-2, 2, "certain")
    shape = tk.load(path)
    assert (tk.euler(shape), tk.genus(shape), tk.report(shape, locate=True).location is None) == (-2, 2, False)
    assert tk.report(path, n_samples=500).euler == -2
    with pytest.raises(GenusError):
        tk.genus(
            tk.from_mesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
        )


@pytest.mark.long
@pytest.mark.parametrize("before", ["", "tk.from_mesh"])
def test_report_can_be_called_whatever_was_imported_before(before: str) -> None:
    """Its name is that of a package, which an import would put in its place (see tests/test_house.py)."""
    code = f"import topokit as tk\n{before}\nprint(callable(tk.report))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "True\n"


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("genuss", "genus"),
        ("is_watertight", "is_closed"),
        ("vertices", "mesh"),
        ("euler_number", "euler"),
        ("n_component", "n_components"),
    ],
)
def test_a_wrong_name_suggests_the_right_one(wrong: str, right: str) -> None:
    shape = tk.from_mesh(torus_mesh())
    with pytest.raises(AttributeError, match=f"{wrong}.*{right}"):
        getattr(shape, wrong)
    assert not hasattr(shape, wrong)


@pytest.mark.parametrize(("wrong", "right"), [("boundaries", "boundary_loops"), ("genuss", "genus")])
def test_a_wrong_name_of_a_report_suggests_the_right_one(wrong: str, right: str) -> None:
    report = tk.from_mesh(torus_mesh()).report()
    with pytest.raises(AttributeError, match=f"{wrong}.*{right}"):
        getattr(report, wrong)
    assert pickle.loads(pickle.dumps(report)) == report


def test_a_wrong_name_of_the_package_suggests_the_right_one() -> None:
    with pytest.raises(AttributeError, match=r"BettiError.*compare\(a, b\).betti_error"):
        _ = tk.BettiError


def test_a_handle_has_a_center() -> None:
    [handle] = tk.from_mesh(torus_mesh(major=1, minor=0.4)).handles()
    assert np.allclose(handle.center, 0), "in the hole, which is where the tunnel is"


def test_plug_ins_find_what_they_need() -> None:
    from topokit.plugins import head, reading

    assert callable(head)
    assert callable(reading)


def test_a_shape_is_no_array() -> None:
    with pytest.raises(tk.InputError, match=r"save\(\)"):
        np.asarray(tk.from_mesh(torus_mesh()))
