"""Text of any origin: what people are shown, and what JSON holds."""

from __future__ import annotations

import json

import pytest

from topokit.text import as_unicode, is_unicode, json_text, printable

HOSTILE = {
    "plain é 東 😀.stl": "plain é 東 😀.stl",
    "a\x1b[31mb": r"a\x1b[31mb",
    "a\x9b31mb": r"a\x9b31mb",
    "a\r\n\tb\x7f": r"a\r\n\tb\x7f",
    "a\u2028b\u202eply.exe": r"a\u2028b\u202eply.exe",
    "caf\udcff\udce9": r"caf\xff\xe9",
    "\ud800": r"\ud800",
}


@pytest.mark.parametrize("text", HOSTILE)
def test_nothing_is_left_that_a_terminal_obeys(text: str) -> None:
    assert printable(text) == HOSTILE[text]
    assert printable(printable(text)) == printable(text)
    assert "\n" not in printable(text)
    printable(text).encode()


@pytest.mark.parametrize("ascii", [False, True])
@pytest.mark.parametrize("indent", [None, 2])
def test_json_loses_only_bytes_that_are_not_utf_8(ascii: bool, indent: int | None) -> None:
    value = {"texts": list(HOSTILE), "numbers": [1, 2.5, None, True]}
    text = json_text(value, indent=indent, ascii=ascii)
    assert json.loads(text) == value | {"texts": list(map(as_unicode, HOSTILE))}
    assert all(line == printable(line) for line in text.split("\n"))
    assert not ascii or text.isascii()
    text.encode()
    with pytest.raises(ValueError, match="JSON"):
        json_text(float("nan"))


def test_unicode_is_what_utf_8_can_hold() -> None:
    assert [is_unicode(text) for text in HOSTILE] == [True] * 5 + [False] * 2
    assert as_unicode("caf\udcff\x1b") == "caf\\xff\x1b"
