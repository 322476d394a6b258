"""Conformance tests for adapters: inherit the class, name the adapter, give one example file, run pytest."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar
from unittest import SkipTest

import torch
from torch import Tensor

from topokit.core.neighbors import nearest_neighbors
from topokit.core.samples import SurfaceSamples
from topokit.errors import AdapterError, TopokitError, summary
from topokit.inputs.remote import lies_in
from topokit.plugins.adapter import Adapter
from topokit.plugins.foreign_code import answer_of, foreign_code
from topokit.plugins.registry import adapter_for, list_adapters
from topokit.shape import Shape

_FOREIGN = {
    "text": b"These are words, not a shape.\n" * 40,
    "zeros": bytes(5000),
    "counting": bytes(range(256)) * 20,
    "picture": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + bytes(range(200)),
}
_CUTS = (0.9, 0.5, 0.1)
_FLIPPED = 0.05  # share of neighbors with opposite normals that sharp edges explain


class AdapterConformance:
    """Tests that every adapter must pass; the tests of a plug-in inherit them:

        class TestBlobs(AdapterConformance):
            adapter = Blobs
            euler = 2

            def example(self, folder):
                path = folder / "one.blob"
                path.write_text("BLOB 1 0.5\\n")
                return path

    Every check is a method that pytest finds; importing this does not need pytest. The plug-in must be installed or
    registered, so that `load` finds it.

    Attributes:
        adapter: the adapter, as a class or an instance.
        options: passed to the adapter with the example, to make it quick.
        euler: χ of the example's surface; None skips the check of the report.
        closed: whether the example's surface is closed, so that its normals can point outward.
        notices_truncation: False for formats in which the beginning of a file is a valid file, such as lists of points.
        heavy: modules that importing the adapter must not import, besides torch and those it `requires`.
    """

    adapter: ClassVar[type[Adapter] | Adapter]
    options: ClassVar[Mapping[str, Any]] = {}
    euler: ClassVar[int | None] = None
    closed: ClassVar[bool] = True
    notices_truncation: ClassVar[bool] = True
    heavy: ClassVar[tuple[str, ...]] = ()

    def example(self, folder: Path) -> Path:
        """Path of an example file, in `folder` or elsewhere."""
        raise NotImplementedError(f"{type(self).__name__} needs a method example(self, folder) that returns a path.")

    def tensors(self) -> tuple[Tensor, ...]:
        """Small float64 tensors from which `source_of` makes an object, for an adapter that is `differentiable`."""
        raise NotImplementedError(
            f"{self._adapter.name} claims to be differentiable: {type(self).__name__} needs the methods tensors(self) "
            "and source_of(self, *tensors)."
        )

    def source_of(self, *tensors: Tensor) -> object:
        """The object made of such tensors, which the adapter opens."""
        raise NotImplementedError(f"{type(self).__name__} needs a method source_of(self, *tensors).")

    def address(self, folder: Path) -> str:
        """An address that the adapter opens where it is, for one with `addresses`: perhaps that of a file there."""
        raise NotImplementedError(
            f"{self._adapter.name} claims to open addresses: {type(self).__name__} needs a method "
            "address(self, folder)."
        )

    # recognition

    def test_it_is_listed_as_usable(self) -> None:
        found = next((found for found in list_adapters() if found.name == self._adapter.name), None)
        assert found is not None, (
            f"adapter {self._adapter.name!r} is not known to topokit: install the package whose entry point "
            "(group topokit.adapters) names it, or call register_adapter."
        )
        assert found.usable, f"adapter {found.name!r} is listed, but not usable: {found.state}"
        assert found.description.strip(), f"adapter {found.name!r} has no description."

    def test_load_finds_it(self, tmp_path: Path) -> None:
        path = self.example(tmp_path)
        if self._adapter.runs_code is not None:
            raise SkipTest("the adapter runs code, so load never chooses it")
        found = adapter_for(path)
        assert found.name == self._adapter.name, (
            f"load opens {path.name} with adapter {found.name!r}, not {self._adapter.name!r}: recognize the content in "
            "can_open(), or give the adapter a suffix of its own or a higher priority."
        )

    def test_it_leaves_other_files_alone(self, tmp_path: Path) -> None:
        for name, content in _FOREIGN.items():
            path = tmp_path / name
            path.write_bytes(content)
            assert not self._adapter.can_open(path), (
                f"can_open() claims a file of {name}: it should be True only where the content leaves no doubt."
            )
        assert not self._adapter.can_open(tmp_path), "can_open() claims a folder of other files."

    def test_importing_it_imports_nothing_heavy(self) -> None:
        has_class = type(self._adapter) is not Adapter
        module = (type(self._adapter) if has_class else self._adapter.can_open).__module__
        heavy = ("torch", *self._adapter.requires, *self.heavy)
        script = f"import sys, {module}; print(*[name for name in {heavy!r} if name in sys.modules])"
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment)
        assert run.returncode == 0, f"import {module} fails in a fresh interpreter:\n{run.stderr}"
        assert not run.stdout.strip(), (
            f"import {module} imports {run.stdout.strip()}, and topokit imports every adapter on the first look-up: "
            "import it in open(), or name an opener in another module."
        )

    # capabilities

    def test_files_of_folders_are_taken(self, tmp_path: Path) -> None:
        if self._adapter.may_open is None:
            raise SkipTest("the adapter takes every file with its suffixes")
        may_open: Any = self._adapter.function("may_open")
        path = self.example(tmp_path)
        assert may_open(path), f"may_open() refuses {path.name}, so folders are examined without such files."

    def test_labels_are_shapes(self, tmp_path: Path) -> None:
        if self._adapter.open_labels is None:
            raise SkipTest("the adapter opens no labels")
        path = self.example(tmp_path)
        shapes = self._labels(path, "all")
        assert shapes, "open_labels() finds no label in the example."
        for label, shape in shapes.items():
            assert isinstance(label, int), f"open_labels() has the label {label!r}; an integer was expected."
            assert isinstance(shape, Shape), (
                f"open_labels() has a {type(shape).__name__}; a topokit.Shape was expected."
            )
        last = max(shapes)
        alone = self._labels(path, [last])
        assert list(alone) == [last], f"open_labels() has the labels {list(alone)} where [{last}] was asked for."
        refusal = _refusal(lambda: self._labels(path, [last + 1]))
        assert refusal is not None, f"the label {last + 1}, which is missing, is opened."
        assert not isinstance(refusal, AdapterError), (
            f"the label {last + 1}, which is missing, gives {refusal!r}; an InputError was expected."
        )

    def test_workers_can_share_what_is_large(self, tmp_path: Path) -> None:
        if self._adapter.is_large is None:
            raise SkipTest("the adapter has no large files")
        options = self._adapter.options()
        assert options is None or "client" in options, (
            "is_large() offers files to all workers of a cluster, but open() has no option `client` for them."
        )
        is_large: Any = self._adapter.function("is_large")
        answer = is_large(self.example(tmp_path), {})
        assert isinstance(answer, bool), f"is_large() returns {answer!r} without options; True or False was expected."

    def test_addresses_are_opened_where_they_are(self, tmp_path: Path) -> None:
        if not self._adapter.addresses:
            raise SkipTest("the adapter opens addresses through copies")
        address = self.address(tmp_path)
        assert lies_in(address, self._adapter.addresses), (
            f"{address} is no address of a folder with the suffix {' or '.join(self._adapter.addresses)}."
        )
        with foreign_code(f"open() failed for {address}"):
            shape = self._open(address)
        assert isinstance(shape, Shape), f"open() returns {type(shape).__name__}; a topokit.Shape was expected."

    # samples

    def test_it_returns_samples(self, tmp_path: Path) -> None:
        points = self._samples(tmp_path).points
        assert points.ndim == 2, f"points have the shape {tuple(points.shape)}; (N, 3) was expected of a file."
        assert points.dtype in (torch.float32, torch.float64), (
            f"points are {points.dtype}; float32 or float64 was expected."
        )
        assert points.device.type == "cpu", f"points of a file are on {points.device}; they belong on the CPU."
        assert len(torch.unique(points, dim=0)) > 0.5 * len(points), "more than half of the points are duplicates."

    def test_samples_are_finite(self, tmp_path: Path) -> None:
        samples = self._samples(tmp_path)
        for name in ("points", "normals", "frames", "areas"):
            values = getattr(samples, name)
            assert values is None or bool(torch.isfinite(values).all()), f"{name} hold NaN or infinite values."

    def test_normals_point_outward(self, tmp_path: Path) -> None:
        shape = self._open(self.example(tmp_path))
        normals = shape.samples.known_normals()
        if normals is None or not shape.samples.oriented:
            raise SkipTest("the samples have no oriented normals")
        points, normals = shape.samples.points.detach(), normals.detach()
        lengths = normals.norm(dim=-1, keepdim=True)
        assert bool((lengths > 0).all()), "some normals are zero."
        normals = normals / lengths
        across = (normals[:, None] * normals[nearest_neighbors(points, 6)]).sum(-1)
        flipped = float((across < 0).double().mean())
        assert flipped < _FLIPPED, f"{flipped:.0%} of neighboring normals point in opposite directions."
        if not self.closed:
            raise SkipTest("the example is not closed, so its normals have no outside")
        area = shape.curvature().area.detach()
        volume = float(((points - points.mean(dim=0)) * normals).sum(-1) @ area) / 3
        assert volume > 0, f"the normals point inward: they enclose the volume {volume:g}; flip them."

    def test_the_report_is_right(self, tmp_path: Path) -> None:
        report = self._open(self.example(tmp_path)).report()
        if self.euler is None:
            raise SkipTest("the tests do not say what χ of the example is: set `euler`")
        assert report.euler == self.euler, (
            f"the report gives χ = {report.euler} ({report.verdict}); {self.euler} was expected."
        )

    # options

    def test_the_same_seed_gives_the_same_samples(self, tmp_path: Path) -> None:
        path = self.example(tmp_path)
        state = torch.random.get_rng_state()
        first, second = (self._open(path).samples.points for _ in range(2))
        assert torch.equal(first, second), "two calls without a generator give different samples: fix the seed."
        if "generator" in (self._adapter.options() or ()):
            one, same, other = (self._open(path, seed=seed).samples.points for seed in (1, 1, 2))
            assert torch.equal(one, same), "two generators of the same seed give different samples."
            assert not torch.equal(one, other), "generators of different seeds give the same samples: use them."
        assert torch.equal(state, torch.random.get_rng_state()), (
            "opening draws from torch's global generator: draw from one of its own, torch.Generator().manual_seed(0)."
        )

    def test_the_number_of_samples_is_what_was_asked_for(self, tmp_path: Path) -> None:
        if "n_samples" not in (self._adapter.options() or ()):
            raise SkipTest("the adapter takes no n_samples")
        for n_samples in (300, 500):
            count = self._open(self.example(tmp_path), n_samples=n_samples).samples.n_points
            assert count == n_samples, f"n_samples={n_samples} gives {count} samples."

    # errors

    def test_a_missing_file_is_named(self, tmp_path: Path) -> None:
        path = self.example(tmp_path).with_name("nowhere" + self.example(tmp_path).suffix)
        self._is_refused(path, "a missing file")

    def test_an_empty_file_is_named(self, tmp_path: Path) -> None:
        path = tmp_path / f"empty{self.example(tmp_path).suffix}"
        path.write_bytes(b"")
        self._is_refused(path, "an empty file")

    def test_a_truncated_file_is_named(self, tmp_path: Path) -> None:
        content = self.example(tmp_path).read_bytes()
        for share in _CUTS:
            path = tmp_path / f"cut{self.example(tmp_path).suffix}"
            path.write_bytes(content[: max(1, int(share * len(content)))])
            self._is_refused(path, f"a file cut off after {share:.0%}", must=self.notices_truncation)

    # gradients

    def test_samples_are_differentiable_where_that_is_claimed(self) -> None:
        if not self._adapter.differentiable:
            raise SkipTest("the adapter does not claim to be differentiable")
        tensors = tuple(tensor.detach().double().requires_grad_() for tensor in self.tensors())

        def points(*values: Tensor) -> Tensor:
            return self._open(self.source_of(*values)).samples.points

        with foreign_code("open() failed for an object of float64 tensors: keep their type and device throughout"):
            value = points(*tensors)
        assert value.dtype == torch.float64, (
            f"samples of float64 tensors are {value.dtype}, too coarse for finite differences: keep the tensors' type."
        )
        assert value.requires_grad, "no gradient flows from the samples to the tensors: something was detached."
        passes = torch.autograd.gradcheck(points, tensors, fast_mode=True, raise_exception=False, atol=1e-4)
        assert passes, "the gradient of the samples differs from their finite differences."
        euler = self._open(self.source_of(*tensors)).gauss_bonnet()
        for index, gradient in enumerate(torch.autograd.grad(euler, tensors, allow_unused=True)):
            finite = gradient is not None and bool(torch.isfinite(gradient).all())
            assert finite, f"the gradient of χ with respect to tensor {index} is missing or not finite."

    @property
    def _adapter(self) -> Adapter:
        return self.adapter() if isinstance(self.adapter, type) else self.adapter

    def _open(self, source: object, seed: int | None = None, **options: Any) -> Shape:
        if seed is not None:
            options["generator"] = torch.Generator().manual_seed(seed)
        return self._adapter.open(source, **{**self.options, **options})

    def _labels(self, path: Path, labels: object) -> Mapping[int, Shape]:
        known = self._adapter.options("open_labels")
        options = {name: value for name, value in self.options.items() if known is None or name in known}
        found: Mapping[int, Shape] = answer_of(self._adapter, "open_labels", path, labels, **options)
        return found

    def _samples(self, folder: Path) -> SurfaceSamples:
        shape = self._open(self.example(folder))
        assert isinstance(shape, Shape), f"open() returns {type(shape).__name__}; a topokit.Shape was expected."
        return shape.samples

    def _is_refused(self, path: Path, what: str, must: bool = True) -> None:
        refusal = _refusal(lambda: self._open(path).samples)
        if isinstance(refusal, AdapterError):
            raise AssertionError(
                f"{what} makes open() raise {summary(refusal.__cause__)}. A TopokitError that names the file was "
                "expected: raise a ReadError yourself, or read in `with topokit.inputs.reading.reading(path, ...)`, "
                "which makes one of ValueError, EOFError and OSError and leaves IndexError and TypeError as they are."
            ) from refusal
        assert refusal is not None or not must, (
            f"{what} is opened as if it were complete; a TopokitError that names the file was expected."
        )
        assert refusal is None or path.name in str(refusal), f"{what} is refused without its name: {refusal}"


def _refusal(act: Callable[[], object]) -> TopokitError | None:
    """The error that an adapter's code raises, as an `AdapterError` if it is not one of ours; None without one."""
    try:
        with foreign_code("it failed"):
            act()
    except TopokitError as error:
        return error
    return None
