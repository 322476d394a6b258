"""The structure holds: import directions, lazy packages, public names, length of modules."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import topokit

ROOT = Path(topokit.__file__).parent
LAYERS = [
    "errors",
    "files",
    "objects",
    "arrays",
    "core",
    "report",
    "witnesses",
    "diagnosis",
    "shape",
    "drawing",
    "base",  # topokit.adapters.base: what an adapter is
    "plugins",
    "choice",
    "registry",
    "adapters",
    "testing",
    "losses",
    "view",
    "cli",
]
HEAVY = ("trimesh", "skimage", "open3d", "plyfile", "rich", "typer")


def imported(path: Path) -> set[str]:
    """topokit modules that a file imports at run time, `if TYPE_CHECKING` left out."""
    found: set[str] = set()
    pending: list[ast.AST] = [ast.parse(path.read_text())]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("topokit."):
            found.add(node.module)
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name.startswith("topokit")}
        pending.extend(ast.iter_child_nodes(node))
    return found


def layer(module: str) -> str:
    if module == "topokit.adapters.base":
        return "base"
    return module.split(".")[1] if "." in module else "cli"


MODULES = sorted(path for path in ROOT.rglob("*.py") if path.stem not in ("__init__", "__main__"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path: Path) -> None:
    own = layer(".".join(("topokit", *path.relative_to(ROOT).with_suffix("").parts)))
    for module in imported(path):
        assert LAYERS.index(layer(module)) <= LAYERS.index(own), f"{path.name} imports {module}"
    if own == "core":
        assert imported(path) <= {m for m in imported(path) if layer(m) in ("core", "errors")}


def test_no_adapter_imports_another() -> None:
    def family(name: str) -> str:
        """mesh and mesh_files are one adapter, and so are point_files and points."""
        return name.removesuffix(".py").split("_")[0].rstrip("s")

    for path in (ROOT / "adapters").rglob("*.py"):
        own = family(path.relative_to(ROOT / "adapters").parts[0])
        for module in imported(path):
            if layer(module) == "adapters":
                assert family(module.split(".")[2]) == own, f"{path.name} imports {module}"


def test_open3d_is_imported_in_one_file_only() -> None:
    importing = [
        path.name for path in MODULES if re.search(r"^\s*(import|from) open3d", path.read_text(), re.MULTILINE)
    ]
    assert importing == ["open3d.py"]


def test_public_names_are_there_and_few() -> None:
    assert len(topokit.__all__) <= 20
    assert sorted(topokit.__all__) == topokit.__all__
    for name in topokit.__all__:
        assert getattr(topokit, name).__doc__, name
    with pytest.raises(AttributeError, match="has no attribute 'nothing'; it has Adapter"):
        _ = topokit.nothing


def loaded_after(code: str) -> set[str]:
    script = f"import sys\n{code}\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    return set(
        subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    )


def test_heavy_packages_wait_until_they_are_needed() -> None:
    assert loaded_after("import topokit").isdisjoint({*HEAVY, "torch", "scipy", "numpy"})
    everything = "; ".join(f"topokit.{name}" for name in topokit.__all__)
    assert loaded_after(f"import topokit; {everything}").isdisjoint(HEAVY)
    assert loaded_after("import topokit.cli").isdisjoint({"torch", "numpy", "scipy", "trimesh", "rich"})
    tetrahedron = "[[0.,0,0],[1,0,0],[0,1,0],[0,0,1]], [[0,2,1],[0,1,3],[0,3,2],[1,2,3]]"
    assert loaded_after(f"import topokit; topokit.from_mesh(({tetrahedron})).report()").isdisjoint(HEAVY)


def test_modules_stay_short() -> None:
    lengths = {path.name: len(path.read_text().splitlines()) for path in MODULES}
    assert max(lengths.values()) <= 320, lengths


def test_no_broad_excepts_and_no_cdist() -> None:
    for path in MODULES:
        text = path.read_text()
        allowed = 1 if path.name == "plugins.py" else 0  # the boundary with code of others; argued there
        assert text.count("except Exception") == allowed, path
        assert "except:" not in text, path
        assert "cdist(" not in text, path
