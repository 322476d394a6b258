"""Options of the command line that are options of adapters, and opening files with them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from topokit.cli.values import is_writable, parse_value
from topokit.errors import InputError

if TYPE_CHECKING:
    from topokit.shape import Shape


_COMMON = {
    "n_neighbors": Annotated[int | None, typer.Option("-k", "--neighbors", min=3, help="Neighbors of each point.")],
    "n_samples": Annotated[int | None, typer.Option("--samples", min=4, help="Points to sample, if any are sampled.")],
    "generator": Annotated[int | None, typer.Option("--seed", min=0, help="Seed of the sampling.")],
}
_TEXTS = {
    "level": "Volumes and networks: value on the surface.",
    "label": "Volumes: voxels with this label are the solid.",
    "connectivity": "Volumes: 6 or 26.",
    "spacing": "Volumes: size of a voxel, as 0.5 or 1,1,2.",
    "bounds": "Networks: lowest and highest corner of the box, as -1,-1,-1,1,1,1.",
    "resolution": "Networks: cells along the longest side of the finest grid.",
    "component": "Splats: all, largest, or the number of a cluster.",
    "min_opacity": "Splats: fainter ones are dropped.",
}
_SAMPLING = ("n_samples", "generator")  # left out where nothing is sampled: a list of files may hold points, too
_RENAMED = {"n_neighbors": "--neighbors", "n_samples": "--samples", "generator": "--seed"}
_ADAPTER = Annotated[str | None, typer.Option("--adapter", help="Adapter to use (`topokit adapters` lists them).")]
_MORE = Annotated[
    list[str] | None,
    typer.Option("-O", "--option", metavar="NAME=VALUE", help="Any other option of the adapter; may be repeated."),
]


def _flag(name: str) -> str:
    """A parameter of an adapter as an option of the command line."""
    if name in (*_RENAMED, *_TEXTS, "adapter"):
        return _RENAMED.get(name) or "--" + name.replace("_", "-")
    return f"-O {name}=…"


_SHARED = {
    "adapter": _ADAPTER,
    **_COMMON,
    **{name: Annotated[str | None, typer.Option(_flag(name), help=text)] for name, text in _TEXTS.items()},
    "more": _MORE,
}
_ANY = inspect.Parameter("any", inspect.Parameter.KEYWORD_ONLY)
# In messages of the library: n_samples, level=…, adapter='mesh'; "level" alone is a word.
_NAMES = "|".join(("adapter", *_TEXTS))
_IN_PYTHON = re.compile(rf"\b(n_neighbors|n_samples|(?:{_NAMES})(?==))(?:='?([^\s',;)]*[^\s',;.)])'?)?")


@dataclass(frozen=True)
class Opener:
    """Opens files with the options of the command line.

    Attributes:
        adapter: name of the adapter, or None to choose by content and suffix.
        given: values by the name of the adapter's parameter; those that are texts are parsed for each adapter.
    """

    adapter: str | None
    given: dict[str, Any]

    def __call__(self, path: Path) -> Shape:
        """The shape of a file.

        Raises:
            InputError: if the adapter has no such option, or a value cannot be parsed.
            TopokitError: whatever `topokit.load` raises.
        """
        from topokit.plugins.foreign_code import options_of
        from topokit.plugins.registry import adapter_for, load

        adapter = adapter_for(path, self.adapter)
        known = options_of(adapter)
        options = {
            name: _value(path, name, value, adapter.name, known)
            for name, value in self.given.items()
            if known is None or name in known or name not in _SAMPLING
        }
        if "generator" in options:
            import torch

            options["generator"] = torch.Generator().manual_seed(options["generator"])
        return load(path, adapter=adapter.name, **options)


def _value(path: Path, name: str, value: Any, adapter: str, known: Mapping[str, inspect.Parameter] | None) -> Any:
    """What the adapter gets for a value of the command line."""
    if known is not None and name not in {*known, "n_neighbors"}:
        writable = {name for name, parameter in known.items() if is_writable(parameter) or name in _SAMPLING}
        flags = ", ".join(sorted(map(_flag, {*writable, "n_neighbors"})))
        raise InputError(f"{path}: adapter {adapter!r} has no option {_flag(name)}. It has: {flags}.")
    if not isinstance(value, str):
        return value
    try:
        return parse_value(value, known[name] if known else _ANY)
    except ValueError as error:
        raise InputError(f"{path}: {_flag(name)} is {value!r}; expected {error}.") from error


def opens_files(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of adapters, which reach it together as its argument `opener`."""
    signature = inspect.signature(command, eval_str=True)
    own = [parameter for parameter in signature.parameters.values() if parameter.name != "opener"]
    shared = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
        for name, annotation in _SHARED.items()
    ]

    @wraps(command)
    def run(**values: Any) -> None:
        given = {name: values.pop(name) for name in (*_COMMON, *_TEXTS)}
        given = {name: value for name, value in given.items() if value is not None}
        for text in values.pop("more") or ():
            name, equals, value = text.partition("=")
            name = name.replace("-", "_")
            if not equals or name in given:
                raise typer.BadParameter(f"-O {text}: expected NAME=VALUE, each name once.")
            if name in _RENAMED:
                raise typer.BadParameter(f"-O {text}: use {_flag(name)} {value}.")
            given[name] = value
        command(opener=Opener(values.pop("adapter"), given), **values)

    keywords = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own]
    run.__signature__ = inspect.Signature([*keywords, *shared])  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in (*keywords, *shared)}
    return run


def in_shell(message: str, path: Path) -> str:
    """A message of the library in terms of the command line: "pass level=…" becomes "pass --level …"."""

    def spelled(match: re.Match[str]) -> str:
        name, value = match.groups()
        return f"{_flag(name)} {value}" if value else _flag(name)

    return str(path).join(_IN_PYTHON.sub(spelled, part) for part in message.split(str(path)))
