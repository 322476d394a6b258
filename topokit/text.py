"""Text that may hold anything, such as the names of files: as people read it, and as JSON holds it."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any

# Control characters, marks that turn the direction of writing, line separators, and halves of a letter (surrogates),
# by which Python stands for bytes of a name that are not UTF-8.
_UNPRINTABLE = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
_SURROGATE = re.compile("[\ud800-\udfff]")
_UNPRINTABLE_IN_JSON = re.compile(f"(?!\n){_UNPRINTABLE.pattern}")  # line ends within texts are escaped before
_NOT_ASCII = re.compile("[^\n -~]")


def printable(text: str) -> str:
    r"""The text in one line, with nothing in it that a terminal obeys: such letters are written as `\x1b` or `\n`."""
    return _UNPRINTABLE.sub(lambda found: _escaped(found[0]), text)


def printable_lines(text: str) -> str:
    """The same line by line, for text of several lines."""
    return "\n".join(map(printable, text.split("\n")))


def is_unicode(text: str) -> bool:
    """Whether UTF-8 can hold the text; it cannot if Python had it from bytes that are not UTF-8."""
    return not _SURROGATE.search(text)


def as_unicode(text: str) -> str:
    r"""The text with `\xff` in place of bytes that are not UTF-8."""
    return _SURROGATE.sub(lambda found: _escaped(found[0]), text)


def json_text(value: Any, *, indent: int | None = None, ascii: bool = False) -> str:
    r"""JSON that every reader takes and a terminal may show.

    Nothing is lost but bytes that are not UTF-8: they become `\xff`, since many readers refuse what JSON has for them.

    Args:
        value: what `json.dumps` takes; numbers must be finite.
        indent: as for `json.dumps`.
        ascii: whether other letters are escaped, too.
    """
    text = json.dumps(value, indent=indent, ensure_ascii=False, allow_nan=False)
    return (_NOT_ASCII if ascii else _UNPRINTABLE_IN_JSON).sub(lambda found: _in_json(found[0]), text)


def _in_json(letter: str) -> str:
    return json.dumps(as_unicode(letter))[1:-1]


def _escaped(letter: str) -> str:
    if "\udc80" <= letter <= "\udcff":
        return f"\\x{ord(letter) - 0xDC00:02x}"
    return letter.encode("unicode_escape").decode("ascii")


def no_attribute(owner: str, name: str, known: Iterable[str], other_words: Mapping[str, str] | None = None) -> str:
    """What an AttributeError says: the missing name, and what may have been meant.

    Args:
        owner: what has no such attribute.
        name: the attribute.
        known: names that exist.
        other_words: what to use instead of names that are usual elsewhere.
    """
    if (meant := (other_words or {}).get(name)) is not None:
        return f"{owner} has no attribute {name!r}. Use {meant}."
    near = nearest(name, known)
    return f"{owner} has no attribute {name!r}." + ("" if near is None else f" Did you mean {near}?")


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The public name that is written almost like another one; None if there is none."""
    return next(iter(get_close_matches(name, [one for one in known if not one.startswith("_")], 1)), None)


def make_logs_printable() -> None:
    """Let messages of libraries that nobody handles, which Python prints on standard error, be printable lines."""
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(_PrintableFormatter())


class _PrintableFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return printable_lines(super().format(record))
