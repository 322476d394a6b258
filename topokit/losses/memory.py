"""What a loss remembers of a thing that is trained, by its key."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict

from torch import Tensor

from topokit.core.grid.field import Field
from topokit.core.grid.grid import Grid
from topokit.core.grid.tau import typical_step
from topokit.errors import InputError
from topokit.losses.guard import Memory

Keys = str | int | Iterable[str | int] | Tensor

# A network in training moves its level set by far less than a cell from one evaluation to the next. What lies two cells
# away is neither decisive nor does it change its side unseen before the next full evaluation.
_BAND_CELLS = 2.0  # distance from the level, in typical changes over one cell, up to which values are evaluated anew


def memories(known: dict[str | int, Memory], keys: Keys | None, n_items: int) -> list[Memory]:
    """The memory of each item, empty ones without keys.

    Raises:
        InputError: if the keys are not one string or integer per item, each once.
    """
    if keys is None:
        return [{} for _ in range(n_items)]
    given = keys.reshape(-1).tolist() if isinstance(keys, Tensor) else keys
    names = [given] if isinstance(given, str | int) else list(given)
    is_named = all(isinstance(name, str | int) and not isinstance(name, bool) for name in names)
    if len(names) != n_items or len(set(names)) != len(names) or not is_named:
        raise InputError(f"keys must be {n_items} different strings or integers, one for each field; got {names!r}.")
    return [known.setdefault(name, {}) for name in names]


def remembered_grid(memory: Memory) -> Grid | None:
    """The grid of the last call."""
    return Grid(**memory["grid"]) if "grid" in memory else None


def values_of(field: Field, memory: Memory, whole_every: int) -> Tensor:
    """The values (X, Y, Z) of a field without a graph, exact near its level and where voxels were decisive.

    A field on another grid than the last is a new one: all else is forgotten. Of a function that is remembered, only
    those values are evaluated that may have changed their side, between evaluations of all in every `whole_every`-th
    call.
    """
    grid = asdict(field.grid)
    if memory.get("grid") != grid:
        memory.clear()
        memory["grid"] = grid
    if not field.is_costly:
        return field.detached()
    n_evaluations = memory.get("n_evaluations", 0)
    if n_evaluations % whole_every == 0:
        values = field.detached()
        memory["width"] = _BAND_CELLS * typical_step(values)
    else:
        values = field.updated(memory["values"], memory["width"], memory.get("decisive"))
    memory["n_evaluations"], memory["values"] = n_evaluations + 1, values
    return values
