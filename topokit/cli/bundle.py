"""Options that several commands have in common, as the fields of dataclasses."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import Parameter
from typing import Any, get_type_hints

Command = Callable[..., None]


def takes_bundles(command: Command) -> Command:
    """The command with an option for each field of those of its arguments that are dataclasses.

    The fields are annotated as typer's options are. What a dataclass raises as `typer.BadParameter` is a usage error.
    """
    own, bundles = [], {}
    for one in inspect.signature(command, eval_str=True).parameters.values():
        if isinstance(one.annotation, type) and is_dataclass(one.annotation):
            bundles[one.name] = one.annotation
        else:
            own.append(one.replace(kind=Parameter.KEYWORD_ONLY))

    @wraps(command)
    def run(**values: Any) -> None:
        made = {
            name: kind(**{one.name: values.pop(one.name) for one in fields(kind)}) for name, kind in bundles.items()
        }
        command(**made, **values)

    for kind in bundles.values():
        hints = get_type_hints(kind, include_extras=True)
        own += [
            Parameter(one.name, Parameter.KEYWORD_ONLY, default=one.default, annotation=hints[one.name])
            for one in fields(kind)
        ]
    run.__signature__ = inspect.Signature(own)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in own}
    return run
