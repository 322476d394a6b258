"""Output that any encoding can carry: what a stream cannot encode is spelled in letters that it can."""

from __future__ import annotations

import codecs
import sys

_SPELLINGS = {
    "−": "-",
    "–": "-",
    "—": "-",
    "…": "...",
    "×": "x",
    "±": "+-",
    "·": ".",
    "≤": "<=",
    "≥": ">=",
    "≠": "!=",
    "≈": "~",
    "→": "->",
    "∞": "inf",
    "½": "1/2",
    "χ": "chi",
    "τ": "tau",
    "σ": "sigma",
    "κ": "kappa",
    "π": "pi",
    "Σ": "sum",
    "°": " degrees",
    "²": "^2",
    "³": "^3",
    "⁻": "-",
    "⁰": "0",
    "¹": "1",
    "ᴷ": "K",
    "⁽": "(",
    "⁾": ")",
    "“": '"',
    "”": '"',
    "‘": "'",
    "’": "'",
    "•": "*",
    "█": "#",
    "━": "-",
    "╸": "-",
    "╺": "-",
    "─": "-",
    "│": "|",
    **dict.fromkeys("╭╮╰╯┌┐└┘├┤┬┴┼", "+"),
}


def use_encodable_letters() -> None:
    """Let standard output and standard error replace what their encodings lack, instead of failing."""
    codecs.register_error("topokit", _spelled)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="topokit")


def carries_all(encoding: str | None) -> bool:
    """Whether an encoding has every letter."""
    return (encoding or "").lower().replace("-", "").startswith("utf")


def _spelled(error: UnicodeError) -> tuple[str | bytes, int]:
    """The error handler: spellings of the letters that could not be encoded, escapes of those that have none."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    spelled = "".join(_SPELLINGS.get(letter, letter) for letter in lacking)
    return spelled.encode("ascii", "backslashreplace").decode("ascii"), error.end
