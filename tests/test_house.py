"""The structure holds: import directions, no circles, lazy packages, public names, length of modules and functions."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import topokit

ROOT = Path(topokit.__file__).parent
FLOORS = [
    {"text", "errors", "ending"},
    {"inputs", "core"},
    {"report", "export"},
    {"pages"},
    {"comparison"},
    {"shape"},
    {"plugins", "losses", "metrics"},
    {"adapters", "testing", "batch"},
    {"repair", "questions", "tolerances", "pairs"},
    {"cli"},
]
CORE_FLOORS = [
    {"arrays", "samples", "neighbors", "linalg", "components", "genus", "labels", "draws"}
    | {"processors", "progress", "surface", "loops", "precision", "residence", "removal"}
    | {"persistence", "separation"},
    {"local", "grid"},
    {"blocks"},
    {"cloud", "mesh", "homotopy", "comparison", "opacity"},
    {"implicit", "scale"},
    {"handles"},
]
HEAVY = ("trimesh", "skimage", "open3d", "plyfile", "potpourri3d", "rich", "typer")
MODULES = sorted(path for path in ROOT.rglob("*.py") if path.stem not in ("__init__", "__main__"))


def module_name(path: Path) -> str:
    return ".".join(("topokit", *path.relative_to(ROOT).with_suffix("").parts))


@cache
def imported(path: Path) -> frozenset[str]:
    """topokit modules that a file imports at run time, `if TYPE_CHECKING` left out."""
    found: set[str] = set()
    pending: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("topokit."):
            found.add(node.module)
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name.startswith("topokit.")}
        pending.extend(ast.iter_child_nodes(node))
    return frozenset(found)


def floor(floors: list[set[str]], room: str) -> int:
    return next(number for number, rooms in enumerate(floors) if room in rooms)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path: Path) -> None:
    own = module_name(path).split(".")
    for module in imported(path):
        other = module.split(".")
        if other[1] == own[1] == "core":
            mine, theirs = floor(CORE_FLOORS, own[2]), floor(CORE_FLOORS, other[2])
            assert theirs < mine or other[2] == own[2] or theirs == mine == 0, f"{own} imports {module}"
        elif other[1] != own[1]:
            assert floor(FLOORS, other[1]) < floor(FLOORS, own[1]), f"{path.name} imports {module}"
    if own[1] == "core":
        assert {module.split(".")[1] for module in imported(path)} <= {"core", "errors"}


def test_no_import_circle() -> None:
    arrows = {module_name(path): imported(path) for path in MODULES}
    done: set[str] = set()

    def visit(module: str, above: tuple[str, ...]) -> None:
        assert module not in above, " → ".join((*above[above.index(module) :], module))
        if module not in done:
            for other in arrows.get(module, ()):
                visit(other, (*above, module))
            done.add(module)

    for module in arrows:
        visit(module, ())


def test_no_adapter_imports_another() -> None:
    for path in (ROOT / "adapters").rglob("*.py"):
        own = path.relative_to(ROOT / "adapters").parts[0]
        for module in imported(path):
            if module.startswith("topokit.adapters."):
                assert module.split(".")[2] == own, f"{path.name} imports {module}"


def test_rooms_that_serve_every_adapter_know_none() -> None:
    """Adapters declare what they can do; only the registry lists the built-in ones."""
    names = {"mesh", "points", "voxels", "sdf", "occupancy", "splats", "open3d"}
    for path in (path for room in ("batch", "cli", "plugins") for path in (ROOT / room).rglob("*.py")):
        texts = {node.value for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if is_text(node)}
        assert path.name == "registry.py" or not texts & names, f"{path.name} names {texts & names}"
        assert not [module for module in imported(path) if module.startswith("topokit.adapters")], path.name


def is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def test_public_names_are_there_and_few() -> None:
    assert len(topokit.__all__) <= 58
    assert sorted(topokit.__all__) == topokit.__all__
    for name in topokit.__all__:
        assert getattr(topokit, name).__doc__, name
    with pytest.raises(AttributeError, match="nothing"):
        _ = topokit.nothing
    with pytest.raises(AttributeError, match=r"from_pointcloud.*from_points"):
        _ = topokit.from_pointcloud


def loaded_after(code: str) -> set[str]:
    script = f"import sys\n{code}\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    return set(
        subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    )


def test_heavy_packages_wait_until_they_are_needed() -> None:
    assert loaded_after("import topokit").isdisjoint({*HEAVY, "torch", "scipy", "numpy"})
    everything = "; ".join(f"topokit.{name}" for name in topokit.__all__)
    assert loaded_after("import topokit.cli.app").isdisjoint({"torch", "numpy", "scipy", "trimesh", "rich"})
    tetrahedron = "[[0.,0,0],[1,0,0],[0,1,0],[0,0,1]], [[0,2,1],[0,1,3],[0,3,2],[1,2,3]]"
    later = "assert not {'numba', 'scipy.optimize'} & sys.modules.keys()"  # most reports need neither
    name = "import topokit.report.verdict; assert callable(topokit.report)"  # the package does not take its place
    report = f"topokit.from_mesh(({tetrahedron})).report(); {later}; topokit.list_adapters()"
    unknown = "import contextlib\nwith contextlib.suppress(topokit.TopokitError): topokit.load(object())"
    found = loaded_after(f"import topokit; {name}; {report}; {everything}\n{unknown}\nimport topokit.testing")
    assert found.isdisjoint({*HEAVY, "pytest", "_pytest"})


def test_modules_stay_short() -> None:
    lengths = {path.name: len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES}
    assert max(lengths.values()) <= 450, lengths


def test_no_broad_excepts_and_no_cdist() -> None:
    for path in MODULES:
        text = path.read_text(encoding="utf-8")
        allowed = 1 if path.name == "foreign_code.py" else 0  # the boundary with third-party code; argued there
        assert text.count("except Exception") == allowed, path
        assert "except:" not in text, path
        assert "cdist(" not in text, path


def test_open3d_is_imported_in_one_file_only() -> None:
    importing = [
        str(path.relative_to(ROOT))
        for path in MODULES
        if re.search(r"^\s*(import|from) open3d", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert len(importing) == 1
