"""Dictionaries of Gaussian splats as trainers name them: gsplat, nerfstudio, INRIA's 3DGS and 2DGS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from topokit.errors import InputError

_NAMES = {
    "means": ("means", "xyz"),
    "scales": ("scales", "scaling"),
    "quaternions": ("quats", "quaternions", "rotation"),
    "opacities": ("opacities", "opacity"),
}
_CONTAINERS = ("splats", "pipeline", "state_dict", "gauss_params")
SUFFIXES = (".pt", ".pth", ".ckpt")


def tensors_by_name(source: Mapping[str, Any] | torch.nn.ParameterDict) -> dict[str, Any]:
    """The four tensors of a scene.

    Args:
        source: a dictionary with gsplat's names (means, scales, quats, opacities), INRIA's (_xyz, _scaling, _rotation,
            _opacity, with or without the underscore) or nerfstudio's (gauss_params.means, …, after any prefix); or a
            checkpoint that holds such a dictionary under "splats", "pipeline", "state_dict" or "gauss_params".

    Returns:
        Entries means, scales, quaternions and opacities, as they are stored.

    Raises:
        InputError: if one is missing, or two entries have the same meaning.
    """
    inner = next((source[key] for key in _CONTAINERS if key in source and hasattr(source[key], "items")), None)
    if inner is not None:
        return tensors_by_name(inner)
    meanings = {alias: name for name, aliases in _NAMES.items() for alias in aliases}
    keys: dict[str, str] = {}
    for key in map(str, source.keys()):
        name = meanings.get(key.rpartition(".")[2].lstrip("_"))
        if name in keys:
            raise InputError(f"the dictionary has {name} twice, as {keys[name]!r} and as {key!r}: pass one of them.")
        if name is not None:
            keys[name] = key
    missing = [aliases[0] for name, aliases in _NAMES.items() if name not in keys]
    if missing:
        raise InputError(
            f"the dictionary lacks {', '.join(missing)}; it has {_listed(source)}. Expected means, scales, quats and "
            "opacities as gsplat names them, or the names of INRIA (_xyz, _scaling, _rotation, _opacity) or of "
            "nerfstudio (gauss_params.means, …)."
        )
    return {name: source[key] for name, key in keys.items()}


def _listed(source: Mapping[str, Any] | torch.nn.ParameterDict, most: int = 12) -> str:
    keys = [str(key) for key in source.keys()]  # noqa: SIM118 (a ParameterDict iterates over its keys only by name)
    return ", ".join(keys[:most]) + (", …" if len(keys) > most else "") if keys else "no entries"
