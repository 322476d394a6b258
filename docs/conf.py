"""Sphinx configuration: `make docs` builds the site, with warnings as errors."""

from __future__ import annotations

import re
from pathlib import Path

import topokit

ROOT = Path(__file__).resolve().parents[1]

project = "topokit"
author = project_copyright = "the topokit authors"
release = version = topokit.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
exclude_patterns = ["pictures", "site"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = "topokit"
html_theme_options = {"navigation_with_keys": True, "top_of_page_buttons": []}
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
default_role = "literal"  # docstrings are Markdown-like: one backtick is code
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True


def _escape_markup(app: object, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """In docstrings |x| is an absolute value and **options are arguments: only backticks are markup."""
    for number, line in enumerate(lines):
        outside_code = re.split(r"(`[^`]*`)", line)
        outside_code[::2] = [re.sub(r"([|*])", r"\\\1", part) for part in outside_code[::2]]
        lines[number] = "".join(outside_code)


def setup(app: object) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", _escape_markup)  # type: ignore[attr-defined]
