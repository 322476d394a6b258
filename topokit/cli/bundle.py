"""Several options of the command line that reach a command as one argument."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

Command = Callable[..., None]


def bundled(argument: str, options: Mapping[str, Any], build: Callable[..., Any]) -> Callable[[Command], Command]:
    """A decorator that gives a command options, which reach it together as one of its arguments.

    Args:
        argument: name of the argument.
        options: annotations, as for typer, by the name of the parameter; all are None by default.
        build: makes the argument from the values of the options, by keyword.
    """

    def decorate(command: Command) -> Command:
        signature = inspect.signature(command, eval_str=True)
        own = [one for one in signature.parameters.values() if one.name != argument]
        added = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
            for name, annotation in options.items()
        ]

        @wraps(command)
        def run(**values: Any) -> None:
            given = {name: values.pop(name) for name in options}
            command(**{argument: build(**given)}, **values)

        parameters = [*(one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in own), *added]
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {one.name: one.annotation for one in parameters}
        return run

    return decorate
