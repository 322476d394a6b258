"""A small differentiable splatter: views of a mesh, and Gaussians optimized until their views are the same.

Projection as of EWA splatting, compositing from front to back, relocation of faint Gaussians and noise as of Markov
chain Monte Carlo (Kheradmand et al., 3D Gaussian Splatting as Markov Chain Monte Carlo, doi:10.48550/arXiv.2404.09591).
Colors are flat: no direction changes them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import open3d
import torch
import trimesh
from numpy.typing import NDArray
from torch import Tensor

import topokit as tk
from topokit.adapters.splats.normals import rotation_matrices

Floats = NDArray[np.float64]

SIDE = 64  # pixels of an image
FOCAL = 1.8 * SIDE  # in pixels
DISTANCE = 2.6  # of a camera from the middle of a scene of extent one
SMOOTHING = 0.3  # pixels², added to the projected covariances, as 3DGS does
REACH = 3.0  # standard deviations of a projected Gaussian that are drawn
FAINTEST, FULLEST = 1 / 255, 0.99  # opacities of a Gaussian at a pixel
RAYS = 3  # per pixel along each axis, of the views of a mesh

RATES = {"means": 2e-3, "scales": 1.5e-2, "quaternions": 5e-3, "opacities": 5e-2, "colors": 2e-2}
LAST_RATE = 0.02  # of the rate of means, at the end
DEAD = 0.005  # opacity of Gaussians that are moved to others
EVERY = 50  # steps between relocations, until three quarters are done
NOISE = 500.0  # of the places, in covariances times the rate of means
OPACITY_WEIGHT = SCALE_WEIGHT = 0.01  # of the means of opacities and scales in the loss


@dataclass(frozen=True)
class Camera:
    """Where a view is taken from: rows of the rotation point right, down and ahead."""

    rotation: Tensor
    center: Tensor


def cameras(count: int, *, lowest: float = -1.0, turn: float = 0.0) -> list[Camera]:
    """Cameras around the origin, evenly spread over the sphere above a height (of −1 … 1), looking at it."""
    found = []
    for number in range(count):
        height = lowest + (0.97 - lowest) * (number + 0.5) / count
        angle = turn + number * math.pi * (3 - math.sqrt(5))
        width = math.sqrt(1 - height * height)
        place = torch.tensor([width * math.cos(angle), width * math.sin(angle), height])
        right = torch.nn.functional.normalize(torch.linalg.cross(-place, torch.tensor([0.0, 0.0, 1.0])), dim=0)
        found.append(Camera(torch.stack((right, torch.linalg.cross(-place, right), -place)), DISTANCE * place))
    return found


def photograph(mesh: trimesh.Trimesh, camera: Camera) -> Tensor:
    """A view (SIDE, SIDE, 4) of a mesh: colors times coverage, and coverage. Shaded, with a pattern in space."""
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(np.float32(mesh.vertices), np.uint32(mesh.faces))
    steps = (np.arange(RAYS * SIDE) + 0.5) / RAYS - SIDE / 2
    across, down = np.meshgrid(steps / FOCAL, steps / FOCAL)
    rays = np.stack((across, down, np.ones_like(across)), axis=2) @ camera.rotation.numpy()
    start = np.broadcast_to(camera.center.numpy(), rays.shape)
    hits = scene.cast_rays(np.concatenate((start, rays), axis=2).astype(np.float32), nthreads=1)
    depth, normals = hits["t_hit"].numpy(), hits["primitive_normals"].numpy()
    is_hit = np.isfinite(depth)
    places = start + np.where(is_hit, depth, 0)[..., None] * rays
    light = 0.6 + 0.4 * normals @ np.array([0.36, 0.48, 0.8])
    pattern = np.stack([np.sin(turn * places[..., axis] + axis) for axis, turn in enumerate((19, 23, 29))], axis=2)
    colors = np.clip((0.55 + 0.3 * pattern + 0.1 * np.roll(pattern, 1, axis=2)) * light[..., None], 0, 1)
    view = np.concatenate((colors, np.ones_like(colors[..., :1])), axis=2) * is_hit[..., None]
    return torch.from_numpy(view.reshape(SIDE, RAYS, SIDE, RAYS, 4).mean((1, 3))).float()


def render(splats: dict[str, Tensor], camera: Camera) -> Tensor:
    """A view (SIDE, SIDE, 4) of Gaussians, differentiable in what a trainer stores of them."""
    local = (splats["means"] - camera.center) @ camera.rotation.T
    x, y, z = local.unbind(1)
    none = torch.zeros_like(z)
    jacobian = FOCAL * torch.stack((1 / z, none, -x / z**2, none, 1 / z, -y / z**2), dim=1).reshape(-1, 2, 3)
    turn = rotation_matrices(torch.nn.functional.normalize(splats["quaternions"], dim=1))
    spread = jacobian @ camera.rotation @ turn * splats["scales"].exp()[:, None]
    a, b, _, d = (spread @ spread.mT).flatten(1).unbind(1)
    a, d = a + SMOOTHING, d + SMOOTHING
    inverse = torch.stack((d, -b, a), dim=1) / (a * d - b * b)[:, None]
    places = FOCAL * local[:, :2] / z[:, None] + SIDE / 2
    reach = (REACH * torch.stack((a, d), dim=1).detach().sqrt()).numpy()
    order = z.detach().argsort().numpy()
    opacities, colors = splats["opacities"].sigmoid(), splats["colors"].sigmoid()
    view: Tensor = _Composite.apply(places, inverse, opacities, colors, reach, order)
    return view


def optimized(views: list[Tensor], seen_from: list[Camera], count: int, steps: int, seed: int) -> dict[str, Tensor]:
    """Gaussians, as a trainer stores them, from random places in a cube of side 1.2 to the views of a scene."""
    generator = torch.Generator().manual_seed(seed)
    start = {
        "means": 1.2 * (torch.rand(count, 3, generator=generator) - 0.5),
        "scales": torch.full((count, 3), math.log(0.02)),
        "quaternions": torch.randn(count, 4, generator=generator),
        "opacities": torch.full((count,), -1.0),
        "colors": torch.zeros(count, 3),
    }
    splats = {name: part.requires_grad_() for name, part in start.items()}
    groups = [{"params": [part], "lr": RATES[name]} for name, part in splats.items()]
    adam = torch.optim.Adam(groups, eps=1e-15, fused=True)
    for step in range(steps):
        adam.param_groups[0]["lr"] = RATES["means"] * LAST_RATE ** (step / steps)
        number = int(torch.randint(len(views), (1,), generator=generator))
        behind = torch.rand(3, generator=generator)
        seen, true = (over(view, behind) for view in (render(splats, seen_from[number]), views[number]))
        loss = 0.8 * (seen - true).abs().mean() + 0.2 * (1 - _similarity(seen, true))
        loss = loss + OPACITY_WEIGHT * splats["opacities"].sigmoid().mean()
        loss = loss + SCALE_WEIGHT * splats["scales"].exp().mean()
        adam.zero_grad()
        loss.backward()
        adam.step()
        with torch.no_grad():
            if step % EVERY == 0 and 0 < step < 0.75 * steps:
                _relocate(splats, adam, generator)
            _shake(splats, adam.param_groups[0]["lr"], generator)
    return {name: part.detach() for name, part in splats.items()}


def over(view: Tensor, behind: Tensor) -> Tensor:
    """A view over a background of one color, (SIDE, SIDE, 3)."""
    return view[..., :3] + (1 - view[..., 3:]) * behind


def peak_ratio(views: list[Tensor], seen_from: list[Camera], splats: dict[str, Tensor]) -> float:
    """Peak signal-to-noise ratio over views, in decibels, over white."""
    white = torch.ones(3)
    errors = [
        (over(render(splats, camera), white) - over(view, white)).square().mean()
        for view, camera in zip(views, seen_from, strict=True)
    ]
    return float(-10 * torch.stack(errors).mean().log10())


def as_scene(splats: dict[str, Tensor]) -> tk.GaussianSplats:
    """What a trainer stores as a scene."""
    return tk.GaussianSplats.from_dict({name: part for name, part in splats.items() if name != "colors"})


def _similarity(first: Tensor, second: Tensor) -> Tensor:
    """Structural similarity in windows of seven pixels."""
    pair = torch.stack((first, second)).permute(0, 3, 1, 2)
    window = torch.nn.AvgPool2d(7, stride=4)
    mean, square, product = window(pair), window(pair * pair), window(pair[0] * pair[1])
    variance, both = square - mean * mean, product - mean[0] * mean[1]
    dark, flat = 0.01**2, 0.03**2
    top = (2 * mean[0] * mean[1] + dark) * (2 * both + flat)
    return (top / ((mean * mean).sum(0) + dark) / (variance.sum(0) + flat)).mean()


def _relocate(splats: dict[str, Tensor], adam: torch.optim.Adam, generator: torch.Generator) -> None:
    """Faint Gaussians become copies of opaque ones, which share their opacity so that views stay nearly the same."""
    opacity = splats["opacities"].sigmoid()
    dead = (opacity < DEAD).nonzero()[:, 0]
    if len(dead) == 0:
        return
    source = torch.multinomial(opacity * (opacity >= DEAD), len(dead), replacement=False, generator=generator)
    shared = 1 - (1 - opacity[source]).sqrt()
    smaller = opacity[source] / (2 * shared - shared**2 / math.sqrt(2))
    splats["opacities"][source] = shared.clamp(DEAD, 1 - 1e-6).logit()
    splats["scales"][source] += smaller.log()[:, None]
    for part in splats.values():
        part[dead] = part[source]
        for moment in ("exp_avg", "exp_avg_sq"):
            adam.state[part][moment][source] = 0


def _shake(splats: dict[str, Tensor], rate: float, generator: torch.Generator) -> None:
    """Noise moves faint Gaussians along their own axes."""
    faint = torch.sigmoid(-100 * (splats["opacities"].sigmoid() - DEAD))
    turn = rotation_matrices(torch.nn.functional.normalize(splats["quaternions"], dim=1))
    spread = turn * splats["scales"].exp()[:, None]
    steps = (spread @ (spread.mT @ torch.randn(len(faint), 3, 1, generator=generator)))[..., 0]
    splats["means"] += NOISE * rate * faint[:, None] * steps


class _Composite(torch.autograd.Function):
    """Compositing of projected Gaussians from front to back."""

    @staticmethod
    def forward(  # type: ignore[override]
        context: Any,
        places: Tensor,
        inverse: Tensor,
        opacities: Tensor,
        colors: Tensor,
        reach: NDArray[np.float32],
        order: NDArray[np.int64],
    ) -> Tensor:
        parts = [part.detach().numpy() for part in (places, inverse, opacities, colors)]
        view = np.zeros((SIDE, SIDE, 4), dtype=np.float32)
        _draw(*parts, reach, order, view)
        context.given = (*parts, reach, order, view)
        return torch.from_numpy(view)

    @staticmethod
    def backward(context: Any, slope: Tensor) -> Any:  # type: ignore[override]
        parts = context.given[:4]
        slopes = [np.zeros_like(part) for part in parts]
        _draw_back(*context.given, np.ascontiguousarray(slope.numpy()), *slopes)
        return *map(torch.from_numpy, slopes), None, None


@numba.njit(cache=True, fastmath=True)
def _box(place: Any, reach: Any) -> tuple[int, int, int, int]:
    left, right = max(0, math.ceil(place[0] - reach[0] - 0.5)), min(SIDE, math.floor(place[0] + reach[0] + 0.5))
    top, bottom = max(0, math.ceil(place[1] - reach[1] - 0.5)), min(SIDE, math.floor(place[1] + reach[1] + 0.5))
    return left, right, top, bottom


@numba.njit(cache=True, fastmath=True)
def _draw(places: Any, inverse: Any, opacities: Any, colors: Any, reach: Any, order: Any, view: Any) -> None:
    for splat in order:
        left, right, top, bottom = _box(places[splat], reach[splat])
        a, b, d = inverse[splat]
        for row in range(top, bottom):
            y = row + np.float32(0.5) - places[splat, 1]
            for column in range(left, right):
                x = column + np.float32(0.5) - places[splat, 0]
                power = np.float32(0.5) * (a * x * x + d * y * y) + b * x * y
                if power > REACH**2 / 2:
                    continue
                alpha = min(opacities[splat] * math.exp(-power), np.float32(FULLEST))
                if alpha >= FAINTEST:
                    weight = alpha * (1 - view[row, column, 3])
                    for channel in range(3):
                        view[row, column, channel] += weight * colors[splat, channel]
                    view[row, column, 3] += weight


@numba.njit(cache=True, fastmath=True)
def _draw_back(
    places: Any, inverse: Any, opacities: Any, colors: Any, reach: Any, order: Any, view: Any, slope: Any,
    of_places: Any, of_inverse: Any, of_opacities: Any, of_colors: Any,
) -> None:  # fmt: skip
    """The slopes of what was drawn, from front to back once more: `behind` is what lies behind each Gaussian."""
    clear = np.ones((SIDE, SIDE), dtype=np.float32)
    behind = view.copy()
    for splat in order:
        left, right, top, bottom = _box(places[splat], reach[splat])
        a, b, d = inverse[splat]
        for row in range(top, bottom):
            y = row + np.float32(0.5) - places[splat, 1]
            for column in range(left, right):
                x = column + np.float32(0.5) - places[splat, 0]
                power = np.float32(0.5) * (a * x * x + d * y * y) + b * x * y
                if power > REACH**2 / 2:
                    continue
                shape = math.exp(-power)
                alpha = min(opacities[splat] * shape, np.float32(FULLEST))
                if alpha < FAINTEST:
                    continue
                light = clear[row, column]
                weight, slope_alpha = alpha * light, np.float32(0)
                for channel in range(4):
                    own = colors[splat, channel] if channel < 3 else np.float32(1)
                    behind[row, column, channel] -= weight * own
                    if channel < 3:
                        of_colors[splat, channel] += weight * slope[row, column, channel]
                    left_over = behind[row, column, channel] / (1 - alpha)
                    slope_alpha += slope[row, column, channel] * (light * own - left_over)
                clear[row, column] = light * (1 - alpha)
                if alpha < FULLEST:
                    of_opacities[splat] += slope_alpha * shape
                    pull = slope_alpha * alpha
                    of_places[splat, 0] += pull * (a * x + b * y)
                    of_places[splat, 1] += pull * (b * x + d * y)
                    of_inverse[splat, 0] -= np.float32(0.5) * pull * x * x
                    of_inverse[splat, 1] -= pull * x * y
                    of_inverse[splat, 2] -= np.float32(0.5) * pull * y * y
