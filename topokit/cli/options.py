"""Options of the command line that are options of adapters, and opening files with them."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from topokit.batch.examine import Options, seeded
from topokit.cli.values import expected_value, is_writable, parse_value
from topokit.errors import InputError, MissingDependencyError, TopokitError

if TYPE_CHECKING:
    from topokit.shape import Shape

Text = str | None
_SAMPLING = ("n_samples", "generator")  # left out where nothing is sampled: a list of files may hold points, too
_RENAMED = {"n_neighbors": "--neighbors", "n_samples": "--samples", "generator": "--seed"}
_QUOTES = "'"
_ANY = inspect.Parameter("any", inspect.Parameter.KEYWORD_ONLY)


def _of(help: str, *flags: str, **more: Any) -> Any:
    return typer.Option(*flags, help=help, rich_help_panel="Options of formats", **more)


def _adapter_names() -> list[str]:
    """For the completion of a shell."""
    from topokit.plugins.registry import list_adapters

    return [adapter.name for adapter in list_adapters()]


_ADAPTER = "Adapter to use; `topokit adapters` lists them, `topokit adapters NAME` its options."
_MORE = "Any other option of the adapter; may be repeated."


@dataclass(frozen=True)
class Given:
    """The adapter and its options, each under the name of the adapter's parameter."""

    adapter: Annotated[Text, _of(_ADAPTER, autocompletion=_adapter_names)] = None
    sampling: Annotated[Text, _of("Meshes: how samples are placed: area, feature-size, curvature or even.")] = None
    logits: Annotated[Text, _of("Occupancy networks: true if they return log-odds; level stays a probability.")] = None
    regularize: Annotated[Text, _of("Points: true moves them onto the surface of their winding number.")] = None
    block_points: Annotated[Text, _of("Points: read block by block, with about so many points in a block.")] = None
    level: Annotated[Text, _of("Volumes and networks: value on the surface.", "--level", "--threshold")] = None
    label: Annotated[Text, _of("Volumes: voxels with this label, or one of several, as 1,2, are the solid.")] = None
    connectivity: Annotated[Text, _of("Volumes: 6 or 26.")] = None
    spacing: Annotated[Text, _of("Volumes: size of a voxel, as 0.5 or 1,1,2.")] = None
    origin: Annotated[Text, _of("Volumes: position of the first voxel, as 0,0,-40.")] = None
    periodic: Annotated[Text, _of("Volumes: axes whose ends touch, as true or true,true,false.")] = None
    edges: Annotated[Text, _of("Volumes: cut-out if they were cut from a larger body; else solid.")] = None
    dataset: Annotated[Text, _of("Volumes: path of the array in a zarr group, HDF5 or VTK file.")] = None
    axis: Annotated[Text, _of("Volumes: name or number of the axis of channels or times, as t.")] = None
    channel: Annotated[Text, _of("Volumes: number of the channel or time that is the volume, from 0 on.")] = None
    block_voxels: Annotated[
        Text, _of("Volumes and networks: count block by block, with at most so many voxels in a block.")
    ] = None
    batch_size: Annotated[Text, _of("Networks: points per call, at most; fewer take less memory.")] = None
    bounds: Annotated[
        Text, _of("Networks: lowest and highest corner of the box, as -1,-1,-1,1,1,1, or -1,1 for a cube.")
    ] = None
    resolution: Annotated[Text, _of("Networks: cells along the longest side of the finest grid.")] = None
    field_resolution: Annotated[Text, _of("Networks: cells along the longest side of the grid of the field.")] = None
    object: Annotated[
        bool | None, _of("Splats: only the object in the middle, without its surroundings.", "--object")
    ] = None
    surroundings: Annotated[Text, _of("Splats: true cuts tables, floors and walls off, false keeps them.")] = None
    component: Annotated[Text, _of("Splats: all, largest, middle, or the number of a cluster.")] = None
    min_opacity: Annotated[Text, _of("Splats: fainter ones are dropped.")] = None
    max_size_ratio: Annotated[Text, _of("Splats: those larger than so many times the median are dropped.")] = None
    max_thickness_ratio: Annotated[Text, _of("Splats: those thicker than this share of their size are dropped.")] = None
    min_cluster_share: Annotated[Text, _of("Splats: clusters with a smaller share of them are dropped.")] = None
    n_neighbors: Annotated[int | None, _of("Neighbors of each point.", "-k", "--neighbors", min=3)] = None
    n_samples: Annotated[int | None, _of("Points to sample, if any are sampled.", "--samples", min=4)] = None
    generator: Annotated[int | None, _of("Seed of the sampling.", "--seed", min=0)] = None
    more: Annotated[list[str] | None, _of(_MORE, "-O", "--option", metavar="NAME=VALUE")] = None

    def opener(self) -> Opener:
        """What opens files with these options; a usage error if they fit no adapter."""
        given = {name: value for name in NAMES if (value := getattr(self, name)) is not None}
        for text in self.more or ():
            name, equals, value = text.partition("=")
            name = name.replace("-", "_")
            if not equals or name in given:
                raise typer.BadParameter(f"-O {text}: expected NAME=VALUE, each name once.")
            if name in _RENAMED:
                raise typer.BadParameter(f"-O {text}: use {_flag(name)} {value}.")
            given[name] = value
        if self.adapter is not None and self.adapter not in _adapter_names():
            raise typer.BadParameter(f"--adapter is {self.adapter!r}; expected {' or '.join(_adapter_names())}.")
        for name, value in given.items():
            if isinstance(value, str):
                _check_value(self.adapter, name, value)
        return Opener(self.adapter, given)


NAMES = tuple(one.name for one in fields(Given) if one.name not in ("adapter", "more"))
"""Options of adapters that have a flag of their own."""


def _flag(name: str) -> str:
    """A parameter of an adapter as an option of the command line."""
    if name in (*NAMES, "adapter", "labels"):
        return _RENAMED.get(name) or "--" + name.replace("_", "-")
    return f"-O {name}=…"


@dataclass(frozen=True)
class Opener(Options):
    """Opens files with the options of the command line, whose texts are parsed for each adapter.

    Attributes:
        needs_level: whether the level makes a difference; if not, files that need one are opened with the lowest.
    """

    needs_level: bool = True

    def __call__(self, path: Path | str) -> tuple[str, dict[str, Any]]:
        """The name of the adapter of a file, and its options.

        Raises:
            InputError: if the adapter has no such option, or a value cannot be parsed.
            TopokitError: whatever the choice of an adapter raises.
        """
        from topokit.plugins.foreign_code import options_of
        from topokit.plugins.registry import adapter_for

        adapter = adapter_for(path, self.adapter)
        known = options_of(adapter)
        given = self.given
        if not self.needs_level and known and "level" in known and known["level"].default is None:
            given = given if {"level", "label"} & given.keys() else {"level": float("-inf"), **given}
        return adapter.name, {
            name: _value(path, name, value, adapter.name, known)
            for name, value in given.items()
            if known is None or name in known or name not in _SAMPLING
        }

    def worded(self, error: TopokitError) -> str:
        """The message of an error in terms of the command line: "pass level=…" becomes "pass --level …"."""
        return error.worded(lambda it: _flag(it.name) + ("" if it.value is None else f" {it.value.strip(_QUOTES)}"))

    def open(self, place: Path | str) -> Shape:
        """The shape of a file, or of what is at an address; errors as above and those of `topokit.load`."""
        from topokit.plugins.registry import in_reach, load

        with in_reach(place, self.adapter) as path:
            adapter, options = self(path)
            return load(path, adapter=adapter, **seeded(options))


def _value(path: Path | str, name: str, value: Any, adapter: str, known: Mapping[str, inspect.Parameter] | None) -> Any:
    """What the adapter gets for a value of the command line."""
    if known is not None and name not in {*known, "n_neighbors"}:
        raise InputError(
            f"{path}: adapter {adapter!r} has no option {_flag(name)}. It has: {', '.join(flags_of(known))}."
        )
    if not isinstance(value, str):
        return value
    try:
        return parse_value(value, known[name] if known else _ANY)
    except ValueError as error:
        raise InputError(f"{path}: {_flag(name)} is {value!r}; expected {error}.") from error


def described_options(adapter: str) -> list[dict[str, str]]:
    """The options of an adapter: how each is written on the command line, its default, and what it expects.

    Raises:
        TopokitError: if the adapter is not known, or its options cannot be read.
    """
    from topokit.plugins.foreign_code import options_of
    from topokit.plugins.registry import adapter_for

    rows = []
    for name, parameter in (options_of(adapter_for(None, adapter)) or {}).items():
        if name == "generator":
            rows.append({"option": "--seed", "default": "0", "expected": "an integer"})
        elif is_writable(parameter):
            default = "none" if parameter.default is None else str(parameter.default)
            rows.append({"option": _flag(name), "default": default, "expected": expected_value(parameter)})
    return rows


def flags_of(known: Mapping[str, inspect.Parameter]) -> list[str]:
    """The options of an adapter that can be written on the command line, as they are written there."""
    writable = {name for name, parameter in known.items() if is_writable(parameter) or name in _SAMPLING}
    return sorted(map(_flag, {*writable, "n_neighbors"}))


def _check_value(adapter: str | None, name: str, value: str) -> None:
    """A usage error if no adapter has the option, or none that has it can take the value."""
    expected = []
    for parameter in _parameters(adapter, name):
        try:
            parse_value(value, parameter)
        except ValueError as error:
            expected += str(error).split(" or ")
        else:
            return
    if expected:
        raise typer.BadParameter(f"{_flag(name)} is {value!r}; expected {' or '.join(dict.fromkeys(expected))}.")
    whose = "no adapter has an" if adapter is None else f"adapter {adapter!r} has no"
    raise typer.BadParameter(f"{whose} option {_flag(name)}.")


def _parameters(adapter: str | None, name: str) -> list[inspect.Parameter]:
    """The option of this name of the adapter, or of all that have it."""
    from topokit.plugins.foreign_code import options_of
    from topokit.plugins.registry import list_adapters

    found = []
    for one in list_adapters():
        opens_paths = one.suffixes or not one.types
        if one.problem is None and opens_paths and adapter in (None, one.name):
            try:
                known = options_of(one)
            except MissingDependencyError:  # opening a file with it says so
                known = None
            if known is None or name in known:
                found.append(_ANY if known is None else known[name])
    return found
