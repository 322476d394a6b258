"""The conformance suite: the built-in adapters pass it, and each of its checks fails for an adapter that breaks it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from unittest import SkipTest
from urllib.parse import urlsplit

import numpy as np
import pytest
import torch
import trimesh
from splat_writers import random_scene, write_ply

import topokit as tk
from topokit.adapters.implicit.entry import SDF
from topokit.adapters.mesh.entry import MESH
from topokit.adapters.points.entry import POINTS
from topokit.adapters.splats.entry import SPLATS
from topokit.adapters.voxels.entry import VOXELS
from topokit.core.samples import SurfaceSamples
from topokit.errors import AdapterError, ReadError
from topokit.inputs.reading import reading
from topokit.plugins import registry
from topokit.testing import AdapterConformance, icosphere, sphere_samples, torus_mesh, torus_samples


class TestMesh(AdapterConformance):
    adapter = MESH
    euler = 0
    options = {"n_samples": 2000}

    def example(self, folder: Path) -> Path:
        path = folder / "torus.off"
        trimesh.Trimesh(*torus_mesh(30, 15), process=False).export(path)
        return path

    def tensors(self) -> tuple[torch.Tensor, ...]:
        return (torch.from_numpy(icosphere(1)[0]),)

    def source_of(self, *tensors: torch.Tensor) -> object:
        return tensors[0], icosphere(1)[1]


class TestPoints(AdapterConformance):
    adapter = POINTS
    euler = 0
    notices_truncation = False

    def example(self, folder: Path) -> Path:
        path = folder / "torus.xyz"
        known = torus_samples(3000)
        np.savetxt(path, torch.cat((known.points, known.normals), dim=1).numpy())
        return path

    def tensors(self) -> tuple[torch.Tensor, ...]:
        return (sphere_samples(100).points,)

    def source_of(self, *tensors: torch.Tensor) -> object:
        return tensors[0]


class TestVoxels(AdapterConformance):
    adapter = VOXELS
    euler = 2
    options = {"n_samples": 1000}

    def example(self, folder: Path) -> Path:
        path = folder / "ball.npy"
        axis = np.linspace(-1, 1, 24)
        x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
        np.save(path, x**2 + y**2 + z**2 < 0.7)
        return path

    def address(self, folder: Path) -> str:
        zarr = pytest.importorskip("zarr")
        pytest.importorskip("fsspec")
        zarr.create_array(folder / "ball.zarr", data=np.load(self.example(folder)), chunks=(12, 12, 12))
        return (folder / "ball.zarr").as_uri()


class TestSdf(AdapterConformance):
    adapter = SDF
    euler = 2
    options = {"n_samples": 1000, "resolution": 128}

    def example(self, folder: Path) -> Path:
        class Ball(torch.nn.Module):
            def forward(self, x: torch.Tensor) -> torch.Tensor:
                return x.norm(dim=-1) - 0.7

        path = folder / "ball.pt"
        torch.jit.save(torch.jit.trace(Ball(), torch.rand(4, 3)), path)
        return path


class TestSplats(AdapterConformance):
    adapter = SPLATS
    options = {"n_samples": 2000}

    def example(self, folder: Path) -> Path:
        write_ply(folder / "scene.ply", random_scene(300))
        return folder / "scene.ply"

    def tensors(self) -> tuple[torch.Tensor, ...]:
        scene = random_scene(60)
        return tuple(map(torch.from_numpy, (scene.means, scene.scales, scene.quaternions)))

    def source_of(self, *tensors: torch.Tensor) -> object:
        return tk.GaussianSplats(*tensors, torch.ones(60, dtype=torch.float64))


# an adapter that is right, and what it takes to make it wrong


class Ball(tk.Adapter):
    """A ball by its radius: "BALL 0.5 END"."""

    __module__ = "topokit.plugins.adapter"  # as if it were written in a module that imports nothing heavy
    name = "ball"
    description = "balls"
    suffixes = (".ball",)
    differentiable = True
    addresses = (".balls",)

    def may_open(self, path: Path) -> bool:
        return path.suffix == ".ball"

    def is_large(self, source: Path | str, options: Mapping[str, Any]) -> bool:
        return bool(options.get("n_samples", 0) > 10**6)

    def open_labels(self, source: Path, labels: Any) -> dict[int, tk.Shape]:
        if labels not in ("all", [1]):
            raise tk.errors.InputError(f"{source} has the label 1 alone.")
        return {1: self.open(source)}

    def can_open(self, source: Path) -> bool:
        return source.is_file() and source.read_bytes().startswith(b"BALL")

    def open(
        self, source: Any, *, n_samples: int = 1000, generator: torch.Generator | None = None, client: object = None
    ) -> tk.Shape:
        source = Path(urlsplit(source).path) / "one.ball" if isinstance(source, str) else source
        radius = self.radius(source) if isinstance(source, Path) else source
        known = sphere_samples(n_samples, generator=generator or torch.Generator().manual_seed(0))
        return self.shape(known.points * radius, known.normals)

    def radius(self, path: Path) -> float:
        with reading(path, "the ball reader"):
            _, number, end = path.read_text().split()
            if end != "END":
                raise ReadError(f"{path} lacks its END.")
            return float(number)

    def shape(self, points: torch.Tensor, normals: torch.Tensor) -> tk.Shape:
        return tk.Shape(SurfaceSamples(points, normals))


class BallConformance(AdapterConformance):
    adapter = Ball
    euler = 2

    def example(self, folder: Path) -> Path:
        path = folder / "one.ball"
        path.write_text("BALL 0.5 END")
        return path

    def address(self, folder: Path) -> str:
        (folder / "more.balls").mkdir()
        self.example(folder / "more.balls")
        return (folder / "more.balls").as_uri()

    def tensors(self) -> tuple[torch.Tensor, ...]:
        return (torch.tensor(0.5, dtype=torch.float64),)

    def source_of(self, *tensors: torch.Tensor) -> object:
        return tensors[0]


def run(check: str, adapter: type[tk.Adapter], folder: Path, **attributes: Any) -> None:
    """One check of the suite on one adapter, registered meanwhile."""
    suite = type("Suite", (BallConformance,), {"adapter": adapter, **attributes})()
    method = getattr(suite, check)
    method(*(folder for name in method.__code__.co_varnames[1 : method.__code__.co_argcount] if name == "tmp_path"))


CHECKS = [name for name in dir(AdapterConformance) if name.startswith("test_")]


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    monkeypatch.setattr(registry, "_registered", {})
    return registry.register_adapter


@pytest.mark.parametrize("check", CHECKS)
def test_a_right_adapter_passes(check: str, register: Callable[..., None], tmp_path: Path) -> None:
    register(Ball)
    run(check, Ball, tmp_path)


def shape_of(change: Callable[[torch.Tensor, torch.Tensor], Any]) -> dict[str, Any]:
    return {"shape": lambda self, points, normals: change(points, normals)}


def made(points: torch.Tensor, normals: torch.Tensor | None = None) -> tk.Shape:
    return tk.Shape(SurfaceSamples(points, normals))


def forged(points: torch.Tensor, /, **values: torch.Tensor) -> tk.Shape:
    """Samples that were changed after they were checked."""
    samples = SurfaceSamples(points)
    for name, value in values.items():
        object.__setattr__(samples, name, value)
    return tk.Shape(lambda: samples)


def ends_in_nan(points: torch.Tensor) -> torch.Tensor:
    return torch.cat((points[:-1], points[-1:] * math.nan))


def open_raising(self: Ball, source: Any, **options: Any) -> tk.Shape:
    return made(sphere_samples(1000).points * float(source.read_text().split()[1]))


def open_guessing(self: Ball, source: Any, **options: Any) -> tk.Shape:
    try:
        return made(sphere_samples(1000).points * float(source.read_text().split()[1]))
    except (OSError, ValueError, IndexError):
        return made(sphere_samples(1000).points)


def open_nameless(self: Ball, source: Any, **options: Any) -> tk.Shape:
    if not source.exists() or not source.read_text().endswith("END"):
        raise ReadError("a ball could not be read.")
    return made(sphere_samples(1000).points)


def open_random(self: Ball, source: Any, *, generator: torch.Generator | None = None) -> tk.Shape:
    return made(torch.randn(1000, 3, dtype=torch.float64, generator=generator))


def open_deaf(self: Ball, source: Any, *, generator: torch.Generator | None = None) -> tk.Shape:
    return made(sphere_samples(1000).points)


def open_seeding(self: Ball, source: Any) -> tk.Shape:
    torch.manual_seed(0)
    return made(torch.randn(1000, 3, dtype=torch.float64))


_calls = iter(range(10**6))


def open_counting(self: Ball, source: Any, *, generator: torch.Generator | None = None) -> tk.Shape:
    return made(sphere_samples(1000).points * (1 + next(_calls) * (generator is not None)))


def open_with_holes(self: Ball, source: Any) -> tk.Shape:
    points = sphere_samples(1000).points
    return made(points * source.detach())


def open_halving(self: Ball, source: Any) -> tk.Shape:
    return made(sphere_samples(100).points * (source / 2 + source.detach() / 2))


def open_with_endless_slope(self: Ball, source: Any) -> tk.Shape:
    points = sphere_samples(100).points
    return made(points * source + (source - source.detach()).abs().sqrt() * 0)


def open_every_label(self: Ball, source: Any, labels: Any) -> dict[int, tk.Shape]:
    return {label: self.open(source) for label in ([1] if labels == "all" else labels)}


def open_known_labels(self: Ball, source: Any, labels: Any) -> dict[int, tk.Shape]:
    found = {1: self.open(source)}
    return {label: found[label] for label in (found if labels == "all" else labels)}


BAD: list[tuple[str, dict[str, Any], str]] = [
    ("test_it_is_listed_as_usable", {"name": "bowl"}, r"adapter 'bowl' is not known to topokit: install the package"),
    ("test_it_is_listed_as_usable", {"requires": ("no_such_module",)}, r"not usable: pip install no_such_module"),
    ("test_it_is_listed_as_usable", {"description": " "}, r"has no description"),
    ("test_load_finds_it", {"name": "other", "priority": -1}, r"load opens one.ball with adapter 'ball', not 'other'"),
    ("test_it_leaves_other_files_alone", {"can_open": lambda self, path: True}, r"claims a file of text"),
    ("test_it_leaves_other_files_alone", {"can_open": lambda self, path: path.is_dir()}, r"claims a folder"),
    (
        "test_it_leaves_other_files_alone",
        {"can_open": lambda self, path: path.is_file() and path.read_bytes()[:1] == b"\0"},
        r"claims a file of zeros",
    ),
    (
        "test_importing_it_imports_nothing_heavy",
        {"__module__": "topokit.core.samples"},
        r"import topokit.core.samples imports torch, and",
    ),
    (
        "test_importing_it_imports_nothing_heavy",
        {"__module__": "topokit.cli.app", "requires": ("typer",)},
        r"import topokit.cli.app imports typer, and",
    ),
    ("test_importing_it_imports_nothing_heavy", {"__module__": "no_such_module"}, r"fails in a fresh interpreter"),
    ("test_files_of_folders_are_taken", {"may_open": lambda self, path: False}, r"refuses one.ball"),
    ("test_labels_are_shapes", {"open_labels": lambda self, source, labels: {}}, r"finds no label"),
    ("test_labels_are_shapes", {"open_labels": lambda self, source, labels: {"a": None}}, r"the label 'a'"),
    ("test_labels_are_shapes", {"open_labels": lambda self, source, labels: {1: None}}, r"has a NoneType"),
    (
        "test_labels_are_shapes",
        {"open_labels": lambda self, source, labels: dict.fromkeys((1, 2), self.open(source))},
        r"the labels \[1, 2\] where \[2\]",
    ),
    ("test_labels_are_shapes", {"open_labels": open_every_label}, r"the label 2, which is missing, is opened"),
    ("test_labels_are_shapes", {"open_labels": open_known_labels}, r"gives AdapterError\(.*KeyError"),
    ("test_workers_can_share_what_is_large", {"open": lambda self, source: None}, r"no option `client`"),
    ("test_workers_can_share_what_is_large", {"is_large": lambda self, source, options: None}, r"returns None"),
    (
        "test_addresses_are_opened_where_they_are",
        {"addresses": (".ballpark",)},
        r"more.balls is no address of a folder with the suffix .ballpark",
    ),
    ("test_addresses_are_opened_where_they_are", {"open": lambda self, source: None}, r"returns NoneType"),
    ("test_it_returns_samples", shape_of(lambda points, normals: points), r"open\(\) returns Tensor"),
    ("test_it_returns_samples", shape_of(lambda points, normals: made(points[None])), r"shape \(1, 1000, 3\)"),
    ("test_it_returns_samples", shape_of(lambda points, normals: made(points.half())), r"points are torch.float16"),
    (
        "test_it_returns_samples",
        shape_of(lambda points, normals: forged(points, points=points.to("meta"))),
        r"are on meta; they belong on the CPU",
    ),
    ("test_it_returns_samples", shape_of(lambda points, normals: made(points[:400].repeat(3, 1))), r"duplicates"),
    (
        "test_samples_are_finite",
        shape_of(lambda points, normals: forged(points, points=ends_in_nan(points))),
        r"points hold NaN",
    ),
    (
        "test_samples_are_finite",
        shape_of(lambda points, normals: forged(points, normals=ends_in_nan(normals))),
        r"normals hold NaN",
    ),
    ("test_normals_point_outward", shape_of(lambda p, n: made(p, -n)), r"the normals point inward"),
    ("test_normals_point_outward", shape_of(lambda p, n: made(p, n * (p[:, :1] * 99).sin().sign())), r"opposite"),
    ("test_normals_point_outward", shape_of(lambda p, n: made(p, n * (p[:, :1] > 0))), r"some normals are zero"),
    (
        "test_the_report_is_right",
        shape_of(lambda p, n: made(torch.cat((p, p + 3)), torch.cat((n, n)))),
        r"χ = 4 \(likely\); 2 was expected",
    ),
    ("test_the_same_seed_gives_the_same_samples", {"open": open_random}, r"without a generator give different"),
    ("test_the_same_seed_gives_the_same_samples", {"open": open_deaf}, r"different seeds give the same samples"),
    ("test_the_same_seed_gives_the_same_samples", {"open": open_counting}, r"of the same seed give different"),
    ("test_the_same_seed_gives_the_same_samples", {"open": open_seeding}, r"draws from torch's global generator"),
    (
        "test_the_number_of_samples_is_what_was_asked_for",
        shape_of(lambda p, n: made(p[1:])),
        r"n_samples=300 gives 299 samples",
    ),
    (
        "test_a_missing_file_is_named",
        {"open": open_raising},
        r"a missing file makes open\(\) raise FileNotFoundError: ",
    ),
    ("test_a_missing_file_is_named", {"open": open_guessing}, r"a missing file is opened as if it were complete"),
    ("test_a_missing_file_is_named", {"open": open_nameless}, r"refused without its name: a ball could not be read"),
    ("test_an_empty_file_is_named", {"open": open_raising}, r"an empty file makes open\(\) raise IndexError"),
    ("test_an_empty_file_is_named", {"open": open_guessing}, r"an empty file is opened"),
    ("test_a_truncated_file_is_named", {"open": open_guessing}, r"cut off after 90% is opened"),
    ("test_a_truncated_file_is_named", {"open": open_raising}, r"cut off after 90% is opened"),
    ("test_samples_are_differentiable_where_that_is_claimed", {"open": open_with_holes}, r"something was detached"),
    ("test_samples_are_differentiable_where_that_is_claimed", {"open": open_halving}, r"differs from their finite"),
    (
        "test_samples_are_differentiable_where_that_is_claimed",
        {"open": open_with_endless_slope},
        r"differs from their finite",
    ),
]


@pytest.mark.parametrize(("check", "changes", "message"), BAD)
def test_every_check_catches_what_it_is_for(
    check: str, changes: dict[str, Any], message: str, register: Callable[..., None], tmp_path: Path
) -> None:
    bad = type("Bad", (Ball,), {"__module__": Ball.__module__, **changes})
    if "name" in changes:
        register(Ball)
    if changes.get("name") != "bowl":
        register(bad)
    with pytest.raises(AssertionError, match=message):
        run(check, bad, tmp_path)


def test_every_check_can_fail() -> None:
    assert {check for check, _, _ in BAD} == set(CHECKS)


def test_every_tensor_must_matter(register: Callable[..., None]) -> None:
    radii = tuple(torch.tensor(value, dtype=torch.float64) for value in (0.5, 2.0))
    with pytest.raises(AssertionError, match=r"gradient of χ with respect to tensor 1 is missing or not finite"):
        run(
            "test_samples_are_differentiable_where_that_is_claimed",
            Ball,
            Path(),
            tensors=lambda self: radii,
            source_of=lambda self, *tensors: tensors[0],
        )


def test_a_type_that_is_lost_or_mixed_is_named() -> None:
    check = "test_samples_are_differentiable_where_that_is_claimed"
    coarse = type("Coarse", (Ball,), {"shape": lambda self, points, normals: made(points.float())})
    with pytest.raises(AssertionError, match=r"samples of float64 tensors are torch\.float32.* keep the tensors' type"):
        run(check, coarse, Path())
    mixing = type("Mixing", (Ball,), {"shape": lambda self, points, normals: made(points @ torch.eye(3))})
    with pytest.raises(AdapterError, match=r"float64 tensors: keep their type and device throughout \(RuntimeError: "):
        run(check, mixing, Path())


def test_truncation_need_not_be_noticed_but_must_not_crash(register: Callable[..., None], tmp_path: Path) -> None:
    lenient = type("Lenient", (Ball,), {"open": open_guessing})
    run("test_a_truncated_file_is_named", lenient, tmp_path, notices_truncation=False)
    rough = type("Rough", (Ball,), {"open": open_raising})
    with pytest.raises(AssertionError, match=r"cut off after 10% makes open\(\) raise IndexError"):
        run("test_a_truncated_file_is_named", rough, tmp_path, notices_truncation=False)


def test_what_an_author_has_to_write_is_said(tmp_path: Path) -> None:
    suite = type("Suite", (AdapterConformance,), {"adapter": Ball})()
    with pytest.raises(
        NotImplementedError, match=r"^Suite needs a method example\(self, folder\) that returns a path\.$"
    ):
        suite.test_it_returns_samples(tmp_path)
    with pytest.raises(
        NotImplementedError, match=r"^ball claims to be differentiable: Suite needs the methods tensors"
    ):
        suite.test_samples_are_differentiable_where_that_is_claimed()


def test_what_cannot_be_asked_is_skipped(tmp_path: Path) -> None:
    none = {"differentiable": False, "may_open": None, "is_large": None, "open_labels": None, "addresses": ()}
    plain = type("Plain", (Ball,), {**none, "open": lambda self, source: made(torch.rand(60, 3))})
    words = ("differentiable", "number", "outward", "folders_are_taken", "labels", "large", "addresses")
    for check in CHECKS:
        if any(word in check for word in words):
            with pytest.raises(SkipTest):
                run(check, plain, tmp_path)
    with pytest.raises(SkipTest, match="not closed"):
        run("test_normals_point_outward", Ball, tmp_path, closed=False)
    with pytest.raises(SkipTest, match="set `euler`"):
        run("test_the_report_is_right", Ball, tmp_path, euler=None)
