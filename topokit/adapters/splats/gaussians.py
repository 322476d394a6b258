"""GaussianSplats: a scene of Gaussians as tensors, read from any format, written as 3DGS .ply."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from topokit.adapters.splats.entry import scene_file
from topokit.adapters.splats.formats.choose import read_splats
from topokit.core.linalg import normalize
from topokit.errors import InputError
from topokit.inputs.files import existing_file

_COLUMNS = (
    *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)


@dataclass(frozen=True, eq=False)
class GaussianSplats:
    """N Gaussians.

    Attributes:
        means: (N, 3) centres, any unit of length.
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
        if _leaves(self.scales, 0, torch.inf):
            raise InputError(
                f"{int((self.scales < 0).any(-1).sum())} of {n_splats} splats have a negative scale; "
                "scales are standard deviations. If these are logarithms, as trainers keep them, call .exp() on them."
            )
        if _leaves(self.opacities, 0, 1):
            raise InputError("opacities must lie in 0 … 1. If these are logits, call .sigmoid() on them first.")
        object.__setattr__(self, "quaternions", _unit(self.quaternions))

    def __len__(self) -> int:
        return len(self.means)

    @classmethod
    def from_file(cls, source: str | os.PathLike[str]) -> GaussianSplats:
        """Read a scene; float32 as in the file. Colours and harmonics are left out.

        Args:
            source: .ply (3DGS, 2DGS, compressed), .splat, .spz (1 to 4), .sog, .ksplat, or the folder of an unzipped
                .sog. The content decides, not the suffix. Positions and rotations of .spz are turned into the axes of
                3DGS .ply.

        Raises:
            ReadError: if the file is missing or malformed.
            UnknownFormatError: if it is in none of these formats.
            MissingDependencyError: if .sog or .spz 4 need a package that is not installed.
        """
        table = read_splats(existing_file(scene_file(source)))
        return cls(*(torch.from_numpy(np.ascontiguousarray(column)) for column in table))

    @classmethod
    def from_dict(
        cls, splats: Mapping[str, Any] | torch.nn.ParameterDict, *, activated: bool = False
    ) -> GaussianSplats:
        """A scene from the dictionary of a trainer such as gsplat's.

        Args:
            splats: "means" (N, 3), "scales" (N, 3), "quats" (N, 4) wxyz, "opacities" (N,) or (N, 1); tensors keep
                dtype, device and gradient. A checkpoint that holds such a dictionary under "splats" will do.
            activated: False for what a trainer stores and optimises (log scales, logit opacities); True for what is
                passed to `gsplat.rasterization` (linear scales, opacities 0 … 1).

        Raises:
            InputError: if a key is missing, or values contradict `activated`.
        """
        if "splats" in splats:
            splats = splats["splats"]
        missing = [key for key in ("means", "scales", "quats", "opacities") if key not in splats]
        if missing:
            raise InputError(
                f"the dictionary lacks {', '.join(missing)}; it has {', '.join(map(str, splats.keys()))}. "
                "Expected means, scales, quats and opacities, as gsplat names them."
            )
        means, scales, quats, opacities = (_tensor(splats[key]) for key in ("means", "scales", "quats", "opacities"))
        opacities = opacities.squeeze(-1) if opacities.ndim == 2 and opacities.shape[-1] == 1 else opacities
        if activated:
            return cls(means, scales, quats, opacities)
        if bool((scales > 0).all()) and bool(((opacities >= 0) & (opacities <= 1)).all()):
            raise InputError(
                "all scales are positive and all opacities lie in 0 … 1, so they do not look like logarithms and "
                "logits: pass activated=True if they are linear already."
            )
        return cls(means, scales.exp(), quats, opacities.sigmoid())

    def select(self, rows: Tensor) -> GaussianSplats:
        """The splats at `rows`, (M,) indices or an (N,) mask."""
        return GaussianSplats(self.means[rows], self.scales[rows], self.quaternions[rows], self.opacities[rows])

    def to(self, *args: Any, **kwargs: Any) -> GaussianSplats:
        """Every tensor moved or converted as by `torch.Tensor.to`."""
        parts = (self.means, self.scales, self.quaternions, self.opacities)
        return GaussianSplats(*(part.to(*args, **kwargs) for part in parts))

    def to_ply(self, path: str | os.PathLike[str]) -> None:
        """Write the standard 3DGS .ply: log scales, logit opacities, zero normals and colours, float32.

        A scale of 0 is written as the logarithm of the smallest normal float32, and opacities 0 and 1 as those of
        the nearest numbers between, so every value stays finite.

        Raises:
            InputError: if the folder does not exist or there is no splat to write.
        """
        target = Path(path)
        if not target.parent.is_dir():
            raise InputError(f"the folder of {target} does not exist; make it first.")
        if len(self) == 0:
            raise InputError("there is no splat to write.")
        limits = torch.finfo(torch.float32)
        opacity = self.opacities.detach().double().clamp(limits.tiny, 1 - limits.eps / 2).logit()
        scales = self.scales.detach().double().clamp(min=limits.tiny).log()
        zeros = torch.zeros(len(self), 6, dtype=torch.float64, device=self.means.device)
        parts = (self.means.detach(), zeros, opacity[:, None], scales, self.quaternions.detach())
        table = torch.cat([part.double() for part in parts], dim=1).cpu().numpy().astype("<f4")
        header = "".join(f"property float {name}\n" for name in _COLUMNS)
        with target.open("wb") as file:
            file.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(self)}\n".encode())
            file.write(f"{header}end_header\n".encode())
            table.tofile(file)


def _leaves(values: Tensor, low: float, high: float) -> bool:
    """Whether a value lies outside low … high; NaN does not count. The extremes alone, which are quick, settle most."""
    if values.numel() == 0:
        return False
    least, most = values.detach().aminmax()
    if low <= float(least) and float(most) <= high:
        return False
    return bool(((values < low) | (values > high)).any())


def _unit(quaternions: Tensor) -> Tensor:
    """`normalize`, by a shorter way where there is neither a gradient nor a square out of range."""
    w, x, y, z = quaternions.detach().unbind(-1)
    squared = w * w + x * x + y * y + z * z
    if not quaternions.requires_grad and len(squared) > 0:
        low, high = squared.aminmax()
        if float(low) > 1e-30 and float(high) < 1e30:
            return quaternions * squared.rsqrt().unsqueeze(-1)
    return normalize(quaternions)


def _tensor(values: Tensor | ArrayLike) -> Tensor:
    return values if isinstance(values, Tensor) else torch.from_numpy(np.array(values, dtype=np.float64))


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
