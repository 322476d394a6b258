"""Write thresholds.md from the rules and the table in `topokit.report.verdict`.

python docs/make_thresholds.py
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path

from topokit.report import verdict

PAGE = Path(__file__).with_name("thresholds.md")
RULES: tuple[tuple[str, Callable[..., object]], ...] = (
    ("meshes", verdict.mesh_verdict),
    ("volumes", verdict.volume_verdict),
    ("functions and networks", verdict.function_verdict),
    ("points and splats", verdict.cloud_verdict),
)
HEADER = """# Rules and thresholds of the verdict

Written by `python docs/make_thresholds.py` from [topokit/report/verdict.py](../topokit/report/verdict.py); a test fails
when this page is out of date. How often the verdict is right is in [accuracy.md](accuracy.md).
`python benchmarks/verdict_thresholds.py DATA` shows on which side of each threshold right and wrong answers lie.
"""


def page() -> str:
    """The text of thresholds.md."""
    lines = [HEADER, "| shapes | rule |", "|---|---|"]
    lines += [f"| {shapes} | {(inspect.getdoc(rule) or '').splitlines()[0]} |" for shapes, rule in RULES]
    sources = list(dict.fromkeys(threshold.source for threshold in verdict.THRESHOLDS.values()))
    lines += ["", "| threshold | value | unit | what is compared with it | source |", "|---|---|---|---|---|"]
    for name, threshold in verdict.THRESHOLDS.items():
        number = sources.index(threshold.source) + 1
        lines.append(f"| `{name}` | {threshold.value:g} | {threshold.unit} | {threshold.meaning} | {number} |")
    lines += ["", "Sources:", "", *(f"{number}. {source}" for number, source in enumerate(sources, 1)), ""]
    return "\n".join(lines)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
