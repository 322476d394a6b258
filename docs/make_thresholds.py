"""Write thresholds.md from the rules and the table in `topokit.report.verdict` and the settings of point clouds.

python docs/make_thresholds.py
"""

from __future__ import annotations

import csv
import dataclasses
import inspect
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from topokit.core.cloud.settings import CloudSettings, OutlierSettings
from topokit.report import confidence, verdict

PAGE = Path(__file__).with_name("thresholds.md")
SENSITIVITY = Path(__file__).with_name("sensitivity.csv")
RULES: tuple[tuple[str, Callable[..., object]], ...] = (
    ("meshes", verdict.mesh_verdict),
    ("volumes", verdict.volume_verdict),
    ("functions and networks", verdict.function_verdict),
    ("functions and networks, proven", verdict.proof_verdict),
    ("points and splats", verdict.cloud_verdict),
)
CORE = Path(inspect.getfile(verdict)).parents[1] / "core"
CONFIDENCE = """
## Confidence of point clouds and splats

The log-odds that the integer of a closed cloud is right are {intercept:.3g} minus the sum of coefficient × doubt. The
coefficients are fitted by `python benchmarks/confidence.py`; how well the probability holds is in
[accuracy.md](accuracy.md#confidence).
"""
SETTINGS = """
## Settings of point clouds

The numbers of the reconstruction, in
[topokit/core/cloud/settings.py](../topokit/core/cloud/settings.py). They are passed down from `global_witness`, never
changed for all.

The last column says how many more or fewer answers are right if the number is halved and if it is doubled, of how many
right ones among how many clouds, measured by [benchmarks/sensitivity.py](../benchmarks/sensitivity.py) on wires, open
surfaces, large clouds, given normals, filled space, double sheets, clouds with stray points or clumps far away, and two
to four clouds of 10 000 points whose answers are right although their votes agree least. The row for walls that were
cut through is of clouds without these, so it shows only that nothing else depends on it.
[sensitivity.csv](sensitivity.csv) has more columns.
"""
CONSTANTS = """
## Constants of the numerical core

All other settings of the methods, in the units of their comments. They were found by trial on analytic shapes and on
the shapes of [accuracy.md](accuracy.md); no study of how the results depend on each of them exists.
"""
HEADER = """# Rules and thresholds of the verdict

Written by `python docs/make_thresholds.py` from [topokit/report/verdict.py](../topokit/report/verdict.py); a test fails
when this page is out of date. How often the verdict is right is in [accuracy.md](accuracy.md).
`python benchmarks/confidence.py` fits and checks the confidence.
"""


def page() -> str:
    """The text of thresholds.md."""
    lines = [HEADER, "| shapes | rule |", "|---|---|"]
    lines += [f"| {shapes} | {(inspect.getdoc(rule) or '').splitlines()[0]} |" for shapes, rule in RULES]
    sources = list(dict.fromkeys(threshold.source for threshold in verdict.THRESHOLDS.values()))
    lines += ["", "An answer about points is likely only if it meets those of these conditions that apply:", ""]
    lines += ["| condition | is met if |", "|---|---|"]
    lines += [f"| `{name}` | {meaning} |" for name, meaning in verdict.CONDITIONS.items()]
    lines += [
        "",
        "| threshold | bound | value | unit | what is compared with it | source |",
        "|---|---|---|---|---|---|",
    ]
    for name, threshold in verdict.THRESHOLDS.items():
        number = sources.index(threshold.source) + 1
        row = (f"`{name}`", threshold.bound, f"{threshold.value:g}", threshold.unit, threshold.meaning, str(number))
        lines.append(f"| {' | '.join(row)} |")
    lines += numbered(sources)
    lines += [CONFIDENCE.format(intercept=confidence.INTERCEPT), "| evidence | coefficient | doubt | x |"]
    lines.append("|---|---|---|---|")
    for name, one in confidence.EVIDENCE.items():
        lines.append(f"| `{name}` | {one.coefficient:.3g} | {one.scale} | {one.meaning} |")
    lines += [SETTINGS, *cloud_settings()]
    lines += [CONSTANTS, "| module | constant | meaning |", "|---|---|---|"]
    lines += [f"| `{module}` | `{code}` | {meaning} |" for module, code, meaning in constants()]
    return "\n".join((*lines, ""))


def numbered(sources: Sequence[str]) -> list[str]:
    """A list of sources, to whose numbers a table refers."""
    return ["", "Sources:", "", *(f"{number}. {source}" for number, source in enumerate(sources, 1))]


def cloud_settings() -> Iterator[str]:
    """A table of every setting of point clouds with its value, unit, meaning and source, and the sources."""
    groups = [("outliers", OutlierSettings())]
    groups += [(group.name, getattr(CloudSettings(), group.name)) for group in dataclasses.fields(CloudSettings)]
    rows = [(name, group, one) for name, group in groups for one in dataclasses.fields(group)]
    sources, tried = list(dict.fromkeys(one.metadata["source"] for _, _, one in rows)), sensitivity()
    yield from ("| setting | value | unit | meaning | source | half, double |", "|---|---|---|---|---|---|")
    for name, group, one in rows:
        about, value = one.metadata, shown(getattr(group, one.name))
        number = sources.index(about["source"]) + 1
        effect = "; ".join(tried.get(f"{name}.{one.name}", []))
        yield f"| `{name}.{one.name}` | {value} | {about['unit']} | {about['meaning']} | {number} | {effect} |"
    yield from numbered(sources)


def sensitivity() -> dict[str, list[str]]:
    """What halving and doubling each setting changes, as written by `benchmarks/sensitivity.py`."""
    found: dict[str, list[str]] = {}
    with SENSITIVITY.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            name, _, part = row["setting"].partition("[")
            numbers = f"{row['half']}, {row['double']} of {row['right']}/{row['clouds']}".replace("-", "−")
            found.setdefault(name, []).append(f"{part.rstrip(']')}: {numbers}" if part else numbers)
    return found


def shown(value: object) -> str:
    """A number, a tuple of numbers, or several of these."""
    if dataclasses.is_dataclass(value):
        value = dataclasses.astuple(value)  # type: ignore[arg-type]
    if isinstance(value, tuple):
        nested = any(isinstance(one, tuple) or dataclasses.is_dataclass(one) for one in value)
        return ("; " if nested else ", ").join(shown(one) for one in value)
    return f"{value:,}".replace(",", " ") if isinstance(value, int) else f"{value:g}"


def constants() -> Iterator[tuple[str, str, str]]:
    """Module, code and comment of every commented constant in the numerical core."""
    for path in sorted(CORE.rglob("*.py")):
        for line in path.read_text(encoding="utf-8").splitlines():
            found = re.fullmatch(r"(_?[A-Z][A-Z_0-9]*(?:, _?[A-Z][A-Z_0-9]*)* = .*?)  # (.*)", line)
            if found and not found[1].endswith("["):
                yield str(path.relative_to(CORE).with_suffix("")), found[1], found[2].replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
