"""Options of the command line that are options of adapters, and opening files with them."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from topokit.batch.examine import Options, seeded
from topokit.cli.bundle import bundled
from topokit.cli.values import expected_value, is_writable, parse_value
from topokit.errors import InputError, MissingDependencyError, TopokitError

if TYPE_CHECKING:
    from topokit.shape import Shape

_PANEL = "Options of formats"
_TEXTS = {
    "sampling": "Meshes: how samples are placed: area, feature-size, curvature or even.",
    "logits": "Occupancy networks: true if they return log-odds; the level stays a probability.",
    "regularize": "Points: true moves them onto the surface of their winding number.",
    "block_points": "Points: read block by block, with about so many points in a block.",
    "level": "Volumes and networks: value on the surface.",
    "label": "Volumes: voxels with this label, or with one of several, as 1,2, are the solid.",
    "connectivity": "Volumes: 6 or 26.",
    "spacing": "Volumes: size of a voxel, as 0.5 or 1,1,2.",
    "origin": "Volumes: position of the first voxel, as 0,0,-40.",
    "dataset": "Volumes: path of the array in a zarr group or HDF5 file.",
    "block_voxels": "Volumes and networks: count block by block, with at most so many voxels in a block.",
    "batch_size": "Networks: points per call, at most; fewer take less memory.",
    "bounds": "Networks: lowest and highest corner of the box, as -1,-1,-1,1,1,1, or -1,1 for a cube.",
    "resolution": "Networks: cells along the longest side of the finest grid.",
    "field_resolution": "Networks: cells along the longest side of the grid of the field.",
    "component": "Splats: all, largest, or the number of a cluster.",
    "min_opacity": "Splats: fainter ones are dropped.",
    "max_size_ratio": "Splats: those larger than so many times the median are dropped.",
    "max_thickness_ratio": "Splats: those thicker than this share of their size are dropped.",
    "min_cluster_share": "Splats: clusters with a smaller share of them are dropped.",
}
_ALIASES = {"level": ("--threshold",)}
_SAMPLING = ("n_samples", "generator")  # left out where nothing is sampled: a list of files may hold points, too
_RENAMED = {"n_neighbors": "--neighbors", "n_samples": "--samples", "generator": "--seed"}


def _flag(name: str) -> str:
    """A parameter of an adapter as an option of the command line."""
    if name in (*_RENAMED, *_TEXTS, "adapter", "labels"):
        return _RENAMED.get(name) or "--" + name.replace("_", "-")
    return f"-O {name}=…"


def _adapter_names() -> list[str]:
    """For the completion of a shell."""
    from topokit.plugins.registry import list_adapters

    return [adapter.name for adapter in list_adapters()]


def _text_option(name: str, help_text: str) -> Any:
    option = typer.Option(_flag(name), *_ALIASES.get(name, ()), help=help_text, rich_help_panel=_PANEL)
    return Annotated[str | None, option]


def _integer_option(*flags: str, least: int, help_text: str) -> Any:
    return Annotated[int | None, typer.Option(*flags, min=least, help=help_text, rich_help_panel=_PANEL)]


_ADAPTER = typer.Option(
    "--adapter",
    help="Adapter to use; `topokit adapters` lists them, `topokit adapters NAME` its options.",
    autocompletion=_adapter_names,
    rich_help_panel=_PANEL,
)
_MORE = typer.Option(
    "-O",
    "--option",
    metavar="NAME=VALUE",
    help="Any other option of the adapter; may be repeated.",
    rich_help_panel=_PANEL,
)
_OPTIONS = {
    "adapter": Annotated[str | None, _ADAPTER],
    **{name: _text_option(name, text) for name, text in _TEXTS.items()},
    "n_neighbors": _integer_option("-k", "--neighbors", least=3, help_text="Neighbors of each point."),
    "n_samples": _integer_option("--samples", least=4, help_text="Points to sample, if any are sampled."),
    "generator": _integer_option("--seed", least=0, help_text="Seed of the sampling."),
    "more": Annotated[list[str] | None, _MORE],
}
_QUOTES = "'"
_ANY = inspect.Parameter("any", inspect.Parameter.KEYWORD_ONLY)


class Opener(Options):
    """Opens files with the options of the command line, whose texts are parsed for each adapter."""

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
        return adapter.name, {
            name: _value(path, name, value, adapter.name, known)
            for name, value in self.given.items()
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


def _opener(adapter: str | None, more: list[str] | None, **values: Any) -> Opener:
    """The opener for the values of the options; a usage error if they fit no adapter."""
    given = {name: value for name, value in values.items() if value is not None}
    for text in more or ():
        name, equals, value = text.partition("=")
        name = name.replace("-", "_")
        if not equals or name in given:
            raise typer.BadParameter(f"-O {text}: expected NAME=VALUE, each name once.")
        if name in _RENAMED:
            raise typer.BadParameter(f"-O {text}: use {_flag(name)} {value}.")
        given[name] = value
    if adapter is not None and adapter not in _adapter_names():
        raise typer.BadParameter(f"--adapter is {adapter!r}; expected {' or '.join(_adapter_names())}.")
    for name, value in given.items():
        if isinstance(value, str):
            _check_value(adapter, name, value)
    return Opener(adapter, given)


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


opens_files = bundled("opener", _OPTIONS, _opener)
