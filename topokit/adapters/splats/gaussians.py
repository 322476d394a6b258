"""GaussianSplats: a scene of Gaussians as tensors, read from any format, written as 3DGS .ply."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from topokit.adapters.splats.absorption import OpticalDepth, optical_depth
from topokit.adapters.splats.checkpoints import SUFFIXES, tensors_by_name
from topokit.adapters.splats.cleaning import Kept, Limits, clean, without_floaters
from topokit.adapters.splats.clusters import Component
from topokit.adapters.splats.entry import scene_file
from topokit.adapters.splats.formats.read_splats import read_splats
from topokit.core.linalg import normalize
from topokit.errors import InputError, UnknownFormatError
from topokit.inputs.arrays import as_floating
from topokit.inputs.files import existing_file
from topokit.inputs.ply import write_ply

_MEANS = ("x", "y", "z")
_SCALES = ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")
_COLUMNS = (*_MEANS, *("nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"), *_SCALES, *_ROTATION)


@dataclass(frozen=True, eq=False)
class GaussianSplats:
    """A scene of N Gaussians.

    Attributes:
        means: (N, 3) centers, any unit of length.
        scales: (N, 3) standard deviations along the columns of the rotation, linear (not logarithms), in the unit of
            the means; 2D Gaussians have a third scale of 0.
        quaternions: (N, 4) rotations, wxyz. Any positive length may be given; unit quaternions are kept, and zero
            stays zero.
        opacities: (N,), 0 … 1 (not logits).

    Rows may hold NaN or infinite values, as some files do; `from_splats` drops and counts them.

    Raises:
        InputError: on wrong shapes, types or devices, negative scales, or opacities outside 0 … 1.
    """

    means: Tensor
    scales: Tensor
    quaternions: Tensor
    opacities: Tensor

    def __post_init__(self) -> None:
        n_splats = len(self.means) if isinstance(self.means, Tensor) and self.means.ndim else 0
        shapes = {"means": (n_splats, 3), "scales": (n_splats, 3), "quaternions": (n_splats, 4)}
        for name, shape in {**shapes, "opacities": (n_splats,)}.items():
            _check(getattr(self, name), name, shape, self.means)
        if _any_outside(self.scales, 0, torch.inf):
            raise InputError(
                f"{int((self.scales < 0).any(-1).sum())} of {n_splats} splats have a negative scale; "
                "scales are standard deviations. If these are logarithms, as trainers keep them, call .exp() on them."
            )
        if _any_outside(self.opacities, 0, 1):
            raise InputError("opacities must lie in 0 … 1. If these are logits, call .sigmoid() on them first.")
        object.__setattr__(self, "quaternions", _unit(self.quaternions))

    def __len__(self) -> int:
        return len(self.means)

    @classmethod
    def from_file(cls, source: str | os.PathLike[str]) -> GaussianSplats:
        """Read a scene; float32 as in the file. Colors and harmonics are ignored.

        Args:
            source: .ply (3DGS, 2DGS, compressed), .splat, .spz (1 to 4), .sog, .ksplat, or the folder of an unzipped
                .sog. The content decides before the suffix. Positions and rotations of .spz are turned into the axes of
                3DGS .ply.

        Raises:
            ReadError: if the file is missing or malformed.
            UnknownFormatError: if it is in none of these formats, or a trainer's checkpoint.
            MissingDependencyError: if .sog or .spz 4 need a package that is not installed.
        """
        if Path(source).suffix.lower() in SUFFIXES:
            raise UnknownFormatError(
                f"{source} seems to be a trainer's checkpoint, which is a Python pickle: load it and pass its "
                "dictionary, topokit.from_splats(torch.load(path, weights_only=True))."
            )
        table = read_splats(existing_file(scene_file(source)))
        return cls(*(torch.from_numpy(np.ascontiguousarray(column)) for column in table))

    @classmethod
    def from_dict(
        cls, splats: Mapping[str, Any] | torch.nn.ParameterDict, *, activated: bool = False
    ) -> GaussianSplats:
        """A scene from the dictionary or the loaded checkpoint of a trainer.

        Args:
            splats: means (N, 3), scales (N, 3) or (N, 2), rotations (N, 4) wxyz and opacities (N,) or (N, 1), under the
                names of gsplat, nerfstudio or INRIA (see `topokit.adapters.splats.checkpoints`); tensors keep dtype,
                device and gradient.
            activated: False for what a trainer stores and optimizes (log scales, logit opacities); True for what is
                passed to `gsplat.rasterization` (linear scales, opacities 0 … 1).

        Raises:
            InputError: if an entry is missing, or values contradict `activated`.
        """
        stored = {name: as_floating(value, name, "(N, ...)") for name, value in tensors_by_name(splats).items()}
        means, scales, opacities = stored["means"], stored["scales"], stored["opacities"]
        opacities = opacities.squeeze(-1) if opacities.ndim == 2 and opacities.shape[-1] == 1 else opacities
        if not activated:
            if bool((scales > 0).all()) and bool(((opacities >= 0) & (opacities <= 1)).all()):
                raise InputError(
                    "all scales are positive and all opacities lie in 0 … 1, so they do not look like logarithms and "
                    "logits: pass activated=True if they are linear already."
                )
            scales, opacities = scales.exp(), opacities.sigmoid()
        if scales.ndim == 2 and scales.shape[-1] == 2:
            scales = torch.nn.functional.pad(scales, (0, 1))
        return cls(means, scales, stored["quaternions"], opacities)

    def __getitem__(self, rows: Tensor | slice | int) -> GaussianSplats:
        """The splats at `rows`: an index, a slice, (M,) indices or an (N,) mask."""
        if isinstance(rows, int):
            rows = torch.tensor([rows])
        return GaussianSplats(self.means[rows], self.scales[rows], self.quaternions[rows], self.opacities[rows])

    def to(self, *args: Any, **kwargs: Any) -> GaussianSplats:
        """Every tensor moved or converted as by `torch.Tensor.to`."""
        parts = (self.means, self.scales, self.quaternions, self.opacities)
        return GaussianSplats(*(part.to(*args, **kwargs) for part in parts))

    def object(
        self,
        *,
        min_opacity: float | None = 0.1,
        max_size_ratio: float | None = 10.0,
        surroundings: bool = True,
        min_cluster_share: float | None = 0.01,
        component: Component = "middle",
    ) -> Kept:
        """The object in the middle of a scene, without haze, background, table, floor, walls and floaters.

        The steps are taken in the order of the arguments. Each is a sentence with numbers in `notes`.

        Args:
            min_opacity: splats of lower opacity are dropped (haze). None switches this and the other limits off.
            max_size_ratio: splats whose largest scale exceeds the median this many times are dropped (background).
            surroundings: whether planes on or before which the object stands are cut off with all that is behind them.
                A plane's border is mostly free; surface goes on behind the border of a face of the object.
            min_cluster_share: clusters with less than this share of the remaining area are dropped (floaters).
            component: "middle" keeps the cluster nearest to the middle of the scene, of those with a fifth of the
                largest one's area, and clusters whose centers lie in its box, such as a ring linked with it; "largest",
                "all" and an index as for `from_splats`.

        Returns:
            The `Kept` splats, differentiable in these, with their `rows`.

        Raises:
            InputError: if nothing is left, most rows are broken, or there is no such component.

        Example:
            >>> import topokit as tk, torch
            >>> ball = torch.nn.functional.normalize(torch.randn(500, 3, generator=torch.Generator().manual_seed(0)))
            >>> means = torch.cat((ball, 0.1 * ball[:10] + torch.tensor([5.0, 0, 0])))  # with a floater
            >>> quaternions = torch.tensor([1.0, 0, 0, 0]).expand(510, 4)
            >>> scene = tk.GaussianSplats(means, torch.full((510, 3), 0.1), quaternions, torch.ones(510))
            >>> len(scene.object())
            500
        """
        return clean(self, Limits(min_opacity, max_size_ratio, min_cluster_share, component, surroundings))

    def simplify(self, *, below: float) -> Kept:
        """The splats without floaters: clusters whose box is shorter than a length along every axis.

        Gaps below about two median sizes of splats do not separate clusters.

        Args:
            below: length in units of the means.

        Returns:
            The `Kept` splats, differentiable in these, with their `rows`; `save` writes them in the scene's format.

        Raises:
            InputError: if `below` is not positive, nothing is left, or most rows are broken.
        """
        return without_floaters(self, float(below))

    def detach(self) -> GaussianSplats:
        """The same splats without a graph."""
        parts = (self.means, self.scales, self.quaternions, self.opacities)
        return GaussianSplats(*(part.detach() for part in parts))

    def optical_depth(self, step: float | None = None) -> OpticalDepth:
        """How much light is absorbed on the clearest path from outside to each place: a field to train opacities with.

        The solid that cannot be seen into is where the depth exceeds log 2. As a volume it has all answers of volumes,
        and gradients to means, scales, rotations and opacities. Paths may bend, so cavities and closed passages belong
        to the solid. Each splat absorbs −log(1 − opacity) along a ray through the middle of its disc.

        Args:
            step: of the grid, in units of the means; half the spacing of the splats by default, or more where that grid
                would have over eight million values.

        Returns:
            `OpticalDepth`: values with their spacing and origin, as `from_voxels` takes them.

        Raises:
            InputError: for fewer than two splats, or a step that is not positive.

        Example:
            >>> import math, topokit as tk, torch
            >>> ball = torch.nn.functional.normalize(torch.randn(2000, 3, generator=torch.Generator().manual_seed(0)))
            >>> quaternions = torch.tensor([1.0, 0, 0, 0]).expand(2000, 4)
            >>> opacities = torch.full((2000,), 0.8, requires_grad=True)
            >>> splats = tk.GaussianSplats(ball, torch.full((2000, 3), 0.1), quaternions, opacities)
            >>> found = splats.optical_depth()
            >>> solid = tk.from_voxels(found.values, level=math.log(2), spacing=found.spacing, origin=found.origin)
            >>> int(solid.euler())
            2
            >>> solid.smoothed_euler(0.1).backward()
            >>> bool(opacities.grad.isfinite().all())
            True
        """
        return optical_depth(self, step)

    def to_ply(self, path: str | os.PathLike[str]) -> None:
        """Write the standard 3DGS .ply: log scales, logit opacities, zero normals and colors, float32.

        A scale of 0 is written as the logarithm of the smallest normal float32, and opacities 0 and 1 as those of
        the nearest numbers between, so every value stays finite.

        Raises:
            InputError: if the file is not called .ply, its folder does not exist, or there is no splat to write.
        """
        if len(self) == 0:
            raise InputError("there is no splat to write.")
        limits = torch.finfo(torch.float32)
        opacities = self.opacities.detach().double().clamp(limits.tiny, 1 - limits.eps / 2).logit()
        scales = self.scales.detach().double().clamp(min=limits.tiny).log()
        parts = {_MEANS: self.means, ("opacity",): opacities[:, None], _SCALES: scales, _ROTATION: self.quaternions}
        table = np.zeros(len(self), dtype=[(name, "<f4") for name in _COLUMNS])
        for names, part in parts.items():
            for name, column in zip(names, part.detach().double().cpu().numpy().T, strict=True):
                table[name] = column
        write_ply(path, vertex=table)


def _any_outside(values: Tensor, low: float, high: float) -> bool:
    """Whether a value lies outside low … high; NaN does not count. The extremes, found quickly, mostly suffice."""
    if values.numel() == 0:
        return False
    least, most = values.detach().aminmax()
    if low <= float(least) and float(most) <= high:
        return False
    return bool(((values < low) | (values > high)).any())


def _unit(quaternions: Tensor) -> Tensor:
    """`normalize`, by a faster formula where there is no gradient and no square over- or underflows."""
    w, x, y, z = quaternions.detach().unbind(-1)
    squared = w * w + x * x + y * y + z * z
    if not quaternions.requires_grad and len(squared) > 0:
        low, high = squared.aminmax()
        if float(low) > 1e-30 and float(high) < 1e30:
            return quaternions * squared.rsqrt().unsqueeze(-1)
    return normalize(quaternions)


def _check(value: object, name: str, shape: tuple[int, ...], means: Tensor) -> None:
    if not isinstance(value, Tensor) or not value.is_floating_point():
        found = value.dtype if isinstance(value, Tensor) else type(value).__name__
        raise InputError(f"{name} must be a floating-point tensor, got {found}.")
    if tuple(value.shape) != shape:
        raise InputError(f"{name} must have shape {shape} to match {shape[0]} means, got {tuple(value.shape)}.")
    if value.device != means.device or value.dtype != means.dtype:
        raise InputError(
            f"{name} is {value.dtype} on {value.device}, the means are {means.dtype} on {means.device}: convert one."
        )
