"""Texts of the command line as values of a parameter, by its annotation or its default."""

from __future__ import annotations

import inspect
from ast import literal_eval
from contextlib import suppress
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

_EXPECTED: dict[Any, str] = {
    int: "an integer",
    float: "a number",
    bool: "true or false",
    NoneType: "none",
    literal_eval: "a value as in Python",
}


def parse_value(text: str, parameter: inspect.Parameter) -> Any:
    """The value that a text stands for: of the first of the parameter's types that it fits.

    Tuples, nested or not, are numbers with commas between them.

    Raises:
        ValueError: if it fits none; the message says what was expected.
    """
    kinds = _kinds(parameter)
    for kind in kinds:
        words = text.split(",") if get_origin(kind) is tuple else [text]
        with suppress(LookupError, SyntaxError, ValueError):
            value = _take(kind, words)
            if not words:
                return value
    raise ValueError(expected_value(parameter))


def expected_value(parameter: inspect.Parameter) -> str:
    """What a text for the parameter must be, in words."""
    return " or ".join(map(_expected, _kinds(parameter))) or "something that only Python code can give"


def is_writable(parameter: inspect.Parameter) -> bool:
    """Whether a value of the parameter, other than None, can be written as a text."""
    return any(kind is not NoneType for kind in _kinds(parameter))


def _take(kind: Any, words: list[str]) -> Any:
    """A value of this type from the first words, which are removed."""
    if _is_list(kind):
        return tuple(_take(get_args(kind)[0], words) for _ in range(len(words)))
    if get_origin(kind) is tuple:
        return tuple(_take(one, words) for one in get_args(kind))
    word = words.pop(0).strip()
    if get_origin(kind) is Literal:
        return {str(value): value for value in get_args(kind)}[word]
    if kind is bool:
        return {"true": True, "false": False}[word.lower()]
    return {"none": None}[word.lower()] if kind is NoneType else kind(word)


def _kinds(parameter: inspect.Parameter) -> tuple[Any, ...]:
    """The parameter's types, () if one cannot be written as a text; without an annotation that of its default."""
    annotation = parameter.annotation
    if annotation is parameter.empty or isinstance(annotation, str):
        has_plain_default = isinstance(parameter.default, bool | int | float | str)
        return (type(parameter.default),) if has_plain_default else (literal_eval, str)
    kinds = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
    return kinds if all(map(_is_plain, kinds)) else ()  # arrays, generators, ...


def _is_plain(kind: Any) -> bool:
    if get_origin(kind) is tuple:
        return all(_is_plain(one) for one in get_args(kind) if one is not Ellipsis)
    return kind in (int, float, bool, str, NoneType) or get_origin(kind) is Literal


def _is_list(kind: Any) -> bool:
    """Whether this is a tuple of any length."""
    return get_origin(kind) is tuple and get_args(kind)[-1] is Ellipsis


def _expected(kind: Any) -> str:
    if _is_list(kind):
        return "several values with commas between them"
    if get_origin(kind) is tuple:
        return f"{_size(kind)} values with commas between them"
    if get_origin(kind) is Literal:
        return " or ".join(map(str, get_args(kind)))
    return _EXPECTED.get(kind, "a text")


def _size(kind: Any) -> int:
    return sum(map(_size, get_args(kind))) if get_origin(kind) is tuple else 1
