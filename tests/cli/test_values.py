"""Texts of the command line become values of the types that a parameter is annotated with."""

from __future__ import annotations

import inspect
from typing import Any, Literal

import pytest
from numpy.typing import ArrayLike
from torch import Generator, Tensor

from topokit.cli.values import is_writable, parse_value

Corner = tuple[float, float, float]
Bounds = tuple[Corner, Corner]


def parameter(annotation: Any = inspect.Parameter.empty, default: Any = None) -> inspect.Parameter:
    return inspect.Parameter("x", inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default)


@pytest.mark.parametrize(
    ("text", "annotation", "value"),
    [
        ("3", int, 3),
        ("-3", float, -3.0),
        ("3", float | None, 3.0),
        ("None", float | None, None),
        ("True", bool, True),
        ("1,2", str, "1,2"),
        ("2", float | Corner | None, 2.0),
        ("1, 2,2.5", float | Corner | None, (1.0, 2.0, 2.5)),
        ("-1,-1,-1,1,1,1", Bounds | None, ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))),
        ("largest", Literal["all", "largest"] | int, "largest"),
        ("2", Literal["all", "largest"] | int, 2),
        ("26", Literal[6, 26], 26),
    ],
)
def test_by_annotation(text: str, annotation: Any, value: Any) -> None:
    found = parse_value(text, parameter(annotation))
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(
    ("text", "default", "value"), [("3", 10, 3), ("3", 0.5, 3.0), ("(1, 2)", None, (1, 2)), ("bone", None, "bone")]
)
def test_without_an_annotation_by_the_default(text: str, default: Any, value: Any) -> None:
    for annotation in (inspect.Parameter.empty, "a name that is not imported"):
        found = parse_value(text, parameter(annotation, default))
        assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(
    ("text", "annotation", "expected"),
    [
        ("x", int, "an integer"),
        ("yes", bool | None, "true or false or none"),
        ("1,2", float | Corner, "a number or 3 values with commas between them"),
        ("7", Literal[6, 26], "6 or 26"),
        ("1,1,1,1,1,1,1", Bounds, "6 values with commas between them"),
        ("1", Generator | None, "something that only Python code can give"),
    ],
)
def test_what_does_not_fit_is_refused_with_what_was_expected(text: str, annotation: Any, expected: str) -> None:
    with pytest.raises(ValueError, match=r"\w") as caught:
        parse_value(text, parameter(annotation))
    assert str(caught.value) == expected


def test_tensors_and_generators_are_not_written_in_a_shell() -> None:
    assert not is_writable(parameter(Generator | None))
    assert not is_writable(parameter(Tensor | ArrayLike | None))
    assert is_writable(parameter(float | None))
    assert is_writable(parameter())
