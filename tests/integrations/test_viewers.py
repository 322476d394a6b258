"""Plug-ins of napari, PyVista and Blender, as far as these are installed; each is loaded by its path."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app
from topokit.testing import torus_mesh

PLUGINS = Path(__file__).resolve().parents[2] / "integrations"
TORUS = torus_mesh(24, 12, major=1.0, minor=0.4)


def loaded(path: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(Path(path).stem, PLUGINS / path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def ring() -> np.ndarray:
    solid = np.zeros((9, 9, 5), dtype=np.uint8)
    solid[1:8, 1:8, 1:4] = 3
    solid[3:6, 3:6] = 0
    return solid


def test_napari_gets_a_surface_with_loops(tmp_path: Path) -> None:
    plugin = loaded("napari/topokit_napari/__init__.py")
    trimesh.Trimesh(*TORUS, process=False).export(tmp_path / "torus.off")
    reader = plugin.get_reader(str(tmp_path / "torus.off"))
    (body, loops) = reader(str(tmp_path / "torus.off"))
    assert (body[2], body[1]["metadata"]["report"]["genus"]) == ("surface", 1)
    assert [len(part) for part in body[0]] == [288, 576]
    assert (loops[2], len(loops[0]), len(loops[1]["edge_color"])) == ("shapes", 2, 2)
    assert plugin.get_reader(["a.off", "b.off"]) is None


def test_napari_finds_the_tunnel_of_a_label_where_its_layer_is() -> None:
    plugin = loaded("napari/topokit_napari/__init__.py")
    layer = SimpleNamespace(data=ring(), scale=np.array([2.0, 1.0, 1.0]), translate=np.array([5.0, 0.0, 0.0]))
    ((data, about, kind),) = plugin.tunnels(layer, label=3)
    assert (kind, "tunnels 1," in about["name"], list(about["translate"])) == ("shapes", True, [5, 0, 0])
    middle = np.vstack(data).mean(axis=0)
    assert np.allclose(middle, (8.0, 4.0, 2.0), atol=1.5)  # voxel (4, 4, 2), two units long


def test_the_manifest_of_napari_names_functions_that_exist() -> None:
    npe2 = pytest.importorskip("npe2")
    manifest = npe2.PluginManifest.from_file(PLUGINS / "napari" / "topokit_napari" / "napari.yaml")
    plugin = loaded("napari/topokit_napari/__init__.py")
    names = [command.python_name.split(":")[1] for command in manifest.contributions.commands]
    assert names == ["get_reader", "tunnels"]
    assert all(callable(getattr(plugin, name)) for name in names)
    assert manifest.contributions.readers[0].command == "topokit-napari.get_reader"


@pytest.fixture
def napari(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The real napari with the plug-in as its manifest declares it, and without a screen."""
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    monkeypatch.setenv("NAPARI_CONFIG", str(tmp_path / "settings.yaml"))
    monkeypatch.syspath_prepend(str(PLUGINS / "napari"))
    reason = "napari and Qt are not installed: pip install napari PySide6"
    found = pytest.importorskip("napari", reason=reason)
    pytest.importorskip("qtpy.QtWidgets", reason=reason, exc_type=ImportError)
    npe2 = pytest.importorskip("npe2")
    manifest = npe2.PluginManifest.from_file(PLUGINS / "napari" / "topokit_napari" / "napari.yaml")
    npe2.PluginManager.instance().register(manifest)
    yield found
    npe2.PluginManager.instance().unregister(manifest.name)
    sys.modules.pop("topokit_napari")


def test_napari_itself_opens_a_mesh_and_shows_its_loops(napari: Any, tmp_path: Path) -> None:
    trimesh.Trimesh(*TORUS, process=False).export(tmp_path / "torus.off")
    viewer = napari.Viewer(show=False)
    try:
        body, loops = viewer.open(tmp_path / "torus.off", plugin="topokit-napari")
        assert (type(body).__name__, type(loops).__name__) == ("Surface", "Shapes")
        assert (body.metadata["report"]["genus"], loops.nshapes) == (1, 2)
    finally:
        viewer.close()


def test_the_widget_of_napari_adds_the_tunnels_of_a_label(napari: Any) -> None:
    viewer = napari.Viewer(show=False)
    try:
        labels = viewer.add_labels(ring(), scale=(2, 1, 1), translate=(5, 0, 0))
        _, widget = viewer.window.add_plugin_dock_widget("topokit-napari", "Tunnels of a label")
        assert widget.layer.value is labels
        widget["label"].value = 3
        widget()
        added = viewer.layers[-1]
        assert added.name == "label 3: pieces 1, tunnels 1, cavities 0"
        assert np.allclose(np.vstack(added.data).mean(axis=0) + added.translate, (13.0, 4.0, 2.0), atol=1.5)
    finally:
        viewer.close()


def test_pyvista_has_an_accessor() -> None:
    pyvista = pytest.importorskip("pyvista", minversion="0.48")
    loaded("pyvista/topokit_pyvista.py")
    mesh = pyvista.wrap(trimesh.Trimesh(*TORUS, process=False))
    assert (mesh.topokit.report().genus, mesh.topokit.surface().n_points) == (1, 288)
    assert mesh.topokit.handles().keys() == ["handle 1", "tunnel 1"]
    assert isinstance(pyvista.PolyData(TORUS[0]).topokit.shape, tk.Shape)


def test_blender_gets_the_lines_and_the_centers_of_the_command(tmp_path: Path) -> None:
    addon = loaded("blender/topokit_report.py")
    vertices, faces = TORUS
    addon.write_obj(tmp_path / "mesh.obj", np.add(vertices, (5, 0, 0)).tolist(), faces.tolist())
    words = addon.command("topokit", tmp_path / "mesh.obj")
    lines, centers = addon.answer(CliRunner().invoke(app, words[1:]).stdout)
    assert "genus 1" in lines[0]
    assert np.allclose(centers, [(5, 0, 0)], atol=0.2)
    addon.write_obj(tmp_path / "mesh.obj", vertices.tolist(), faces[1:].tolist())
    lines, centers = addon.answer(CliRunner().invoke(app, words[1:]).stdout)
    assert ("not closed" in lines[0], centers) == (True, [])
    with pytest.raises(ValueError, match="set its path"):
        addon.examine("no-such-command", vertices.tolist(), faces.tolist())


BLENDER = """
import sys
import bpy

addon, program = sys.argv[-2:]
bpy.ops.preferences.addon_install(filepath=addon)
bpy.ops.preferences.addon_enable(module="topokit_report")
bpy.context.preferences.addons["topokit_report"].preferences.program = program
bpy.ops.mesh.primitive_torus_add(location=(5, 0, 0))
bpy.context.active_object.modifiers.new("finer", "SUBSURF")
print(bpy.ops.mesh.topokit_report())
print(*(one.name for one in bpy.data.objects if one.name.startswith("handle")))
print(*(round(x) for x in bpy.data.objects["handle 1"].location))
"""


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="Blender is not installed: pip install bpy")
def test_blender_itself_marks_the_handle_of_a_torus(tmp_path: Path) -> None:
    program = tmp_path / "topokit"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m topokit "$@"\n')
    program.chmod(0o755)
    (tmp_path / "script.py").write_text(BLENDER)
    words = [sys.executable, str(tmp_path / "script.py"), str(PLUGINS / "blender" / "topokit_report.py"), str(program)]
    home = os.environ | {"BLENDER_USER_RESOURCES": str(tmp_path / "blender")}
    ran = subprocess.run(words, env=home, capture_output=True, text=True, timeout=250)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.splitlines()[-3:] == ["{'FINISHED'}", "handle 1", "5 0 0"], ran.stdout
