"""Nothing outside the given file is opened, and no small file grows: references, links, XML entities, nested scenes."""

from __future__ import annotations

import io
import json
import logging
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from intact_files import glb_of, gltf_parts, three_mf_members, zip_members

from topokit.adapters.mesh.files import read_mesh
from topokit.errors import ReadError

ITEM = '<item objectid="2"/>'
LAUGHS = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">{}]>'.format(
    "".join(f'<!ENTITY {chr(98 + n)} "{("&" + chr(97 + n) + ";") * 10}">' for n in range(9))
)


def watch_opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A list to which the name of every file that is opened from now on is added."""
    opened: list[str] = []
    usual = io.open

    def watched(file: Any, *rest: Any, **more: Any) -> Any:
        opened.append(str(file))
        return usual(file, *rest, **more)

    monkeypatch.setattr("builtins.open", watched)
    monkeypatch.setattr("io.open", watched)
    return opened


def scene() -> tuple[dict[str, Any], bytes]:
    return gltf_parts(np.random.default_rng(0))


def read_gltf(folder: Path, description: object) -> tuple[Any, Any]:
    (folder / "scene.gltf").write_text(json.dumps(description))
    return read_mesh(folder / "scene.gltf")


def test_buffers_in_the_folder_of_a_gltf_are_read(tmp_path: Path) -> None:
    description, buffer = scene()
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "my mesh.bin").write_bytes(buffer)
    description["buffers"][0]["uri"] = "parts/my%20mesh.bin"
    _, faces = read_gltf(tmp_path, description)
    assert len(faces) == 2 * description["accessors"][1]["count"] / 3


@pytest.mark.parametrize(
    "uri",
    ["../secret.bin", "%2e%2e/secret.bin", "{folder}/secret.bin", "file://{folder}/secret.bin", "link.bin", "a\\b"],
)
def test_buffers_elsewhere_are_not_opened(uri: str, tmp_path: Path) -> None:
    description, buffer = scene()
    (tmp_path / "inner").mkdir()
    (tmp_path / "secret.bin").write_bytes(buffer)
    (tmp_path / "inner" / "link.bin").symlink_to(tmp_path / "secret.bin")
    description["buffers"][0]["uri"] = uri.format(folder=tmp_path)
    with pytest.raises(ReadError, match="which is not in its folder: it is not opened"):
        read_gltf(tmp_path / "inner", description)


def test_textures_and_materials_are_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    description, buffer = scene()
    description |= {"images": [{"uri": "secret.png"}], "textures": [{"source": 0}]}
    description["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    description["meshes"][0]["primitives"][0]["material"] = 0
    files = {
        "f.glb": glb_of(description, buffer),
        "f.obj": b"mtllib secret.png\nusemtl x\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "f.ply": b"ply\nformat ascii 1.0\ncomment TextureFile secret.png\nelement vertex 3\nproperty float x\n"
        b"property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    }
    (tmp_path / "secret.png").write_bytes(b"not to be opened")
    opened = watch_opened(monkeypatch)
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        assert len(read_mesh(tmp_path / name)[1]) > 0
    assert not [name for name in opened if "secret" in name]


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        ([{"children": [n + 1, n + 1]} for n in range(40)] + [{"mesh": 0}], "two parents"),
        ([{"children": [1]}, {"children": [0]}], "two parents"),
        ([{"children": [1, 2]}, {"children": [3]}, {"children": [3]}, {"mesh": 0}], "two parents"),
    ],
)
def test_nodes_that_are_no_tree_are_refused(nodes: list[object], message: str, tmp_path: Path) -> None:
    description, buffer = scene()
    (tmp_path / "f.glb").write_bytes(glb_of(description | {"nodes": nodes}, buffer))
    with pytest.raises(ReadError, match=message):
        read_mesh(tmp_path / "f.glb")


def test_numbers_that_no_buffer_holds_are_refused(tmp_path: Path) -> None:
    description, buffer = scene()
    description["accessors"][0] = {"componentType": 5126, "count": 10**9, "type": "VEC3"}
    (tmp_path / "f.glb").write_bytes(glb_of(description, buffer))
    with pytest.raises(ReadError, match="announces content of 12000"):
        read_mesh(tmp_path / "f.glb")
    shared, buffer = scene()
    shared["accessors"] = [dict(shared["accessors"][0], count=10**6) for _ in range(1000)]
    (tmp_path / "f.glb").write_bytes(glb_of(shared, buffer))
    with pytest.raises(ReadError, match="announces content of"):
        read_mesh(tmp_path / "f.glb")


def write_3mf(path: Path, change: Any) -> None:
    members = three_mf_members(np.random.default_rng(0))
    model = members["3D/3dmodel.model"].decode()
    path.write_bytes(zip_members({**members, "3D/3dmodel.model": change(model).encode()}))


def test_components_that_multiply_are_refused(tmp_path: Path) -> None:
    def doubled(model: str) -> str:
        inner = '<component objectid="{0}"/><component objectid="{0}"/>'
        objects = (f'<object id="{n}"><components>{inner.format(n - 1)}</components></object>' for n in range(2, 50))
        before, after = model.index('<object id="2">'), model.index("</resources>")
        return model[:before] + "".join(objects) + model[after:].replace(ITEM, '<item objectid="49"/>')

    write_3mf(tmp_path / "f.3mf", doubled)
    with pytest.raises(ReadError, match="hold each other more than 65536 times"):
        read_mesh(tmp_path / "f.3mf")
    write_3mf(tmp_path / "f.3mf", lambda model: model.replace('objectid="1"', 'objectid="2"'))
    with pytest.raises(ReadError, match="hold each other"):
        read_mesh(tmp_path / "f.3mf")


@pytest.mark.parametrize("place", ["<build>", 'type="model"'])
def test_xml_entities_do_not_grow(place: str, tmp_path: Path) -> None:
    def with_laughs(model: str) -> str:
        start = model.index("?>") + 2
        return (
            model[:start] + LAUGHS + model[start:].replace(place, place.rstrip('"') + "&j;" + '"' * place.count('l"'))
        )

    write_3mf(tmp_path / "f.3mf", with_laughs)
    with pytest.raises(ReadError, match=r"amplification|entity reference loop"):
        read_mesh(tmp_path / "f.3mf")


def test_external_xml_entities_are_not_opened(tmp_path: Path) -> None:
    (tmp_path / "secret.txt").write_text("<not/>xml")
    entity = f'<!DOCTYPE x [<!ENTITY a SYSTEM "file://{tmp_path}/secret.txt">]>'
    write_3mf(tmp_path / "f.3mf", lambda m: m.replace("?>", "?>" + entity, 1).replace("<build>", "<build>&a;"))
    assert len(read_mesh(tmp_path / "f.3mf")[1]) > 0


def test_an_archive_bomb_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "f.3mf", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b" " * (80 << 20))
    with pytest.raises(ReadError, match="decompression bomb"):
        read_mesh(tmp_path / "f.3mf")


def test_text_with_fewer_lines_than_rows_is_truncated(tmp_path: Path) -> None:
    header = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    header += b"element face %d\nproperty list uchar int vertex_indices\nend_header\n"
    rows = b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n"
    (tmp_path / "f.ply").write_bytes(header % 2 + rows)
    assert len(read_mesh(tmp_path / "f.ply")[1]) == 2
    (tmp_path / "f.ply").write_bytes(header % 5 + rows)
    with pytest.raises(ReadError, match="announces 9 rows and has 6 lines for them"):
        read_mesh(tmp_path / "f.ply")
    (tmp_path / "f.ply").write_bytes(header % 10**9 + rows)
    with pytest.raises(ReadError, match="1000000000 rows"):
        read_mesh(tmp_path / "f.ply")


PART = """*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 0, 1, 0
4, 0, 0, 1
*ELEMENT, TYPE=C3D4
1, 1, 2, 3, 4
"""


@pytest.mark.parametrize(
    "line",
    [
        "*INCLUDE, INPUT={secret}\n",
        "*Include,input = ../secret.inp\n",
        "  *include , INPUT=beside.inp\r\n",
        "INCLUDE={secret}\n*INCLUDE\n",
        "\r*INCLUDE, INPUT={secret}\r",
    ],
)
def test_abaqus_files_include_no_others(line: str, tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    (tmp_path / "inner").mkdir()
    for name in ("secret.inp", "inner/beside.inp"):
        (tmp_path / name).write_text(PART)
    for start in ("", PART):
        text = start + line.format(secret=tmp_path / "secret.inp")
        (tmp_path / "inner" / "f.inp").write_bytes(text.encode())
        with pytest.raises(ReadError, match="other files than the given one are not opened"):
            read_mesh(tmp_path / "inner" / "f.inp")
    (tmp_path / "inner" / "f.inp").write_text(f"** INCLUDE what you need\n**INCLUDE\n{PART}")
    assert len(read_mesh(tmp_path / "inner" / "f.inp")[1]) == 4


VTU = """<?xml version="1.0"?>{doctype}
<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" xmlns:xi="http://www.w3.org/2001/XInclude">
<UnstructuredGrid><Piece NumberOfPoints="4" NumberOfCells="1"><Points><DataArray type="Float64" NumberOfComponents="3"
format="ascii">{points}</DataArray></Points><Cells>
<DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 3</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">4</DataArray>
<DataArray type="Int64" Name="types" format="ascii">10</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>"""
POINTS = "0 0 0 1 0 0 0 1 0 0 0 1"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize("before", ["", f"<!--{'-x' * 40_000}-->"])
def test_xml_of_vtk_takes_nothing_from_elsewhere(before: str, encoding: str, tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    (tmp_path / "points.txt").write_text(POINTS)
    (tmp_path / "f.vtu").write_text(VTU.format(doctype="", points=POINTS))
    assert len(read_mesh(tmp_path / "f.vtu")[1]) == 4
    external = f'<!DOCTYPE x [<!ENTITY a SYSTEM "{(tmp_path / "points.txt").as_uri()}">]>'
    included = f'<xi:include parse="text" href="{tmp_path}/points.txt"/>'
    for doctype, points in (("", included), (external, "&a;"), (LAUGHS, "&j;" * 9)):
        text = VTU.format(doctype=before + doctype, points=points).replace("1.0", f'1.0" encoding="{encoding}', 1)
        (tmp_path / "f.vtu").write_bytes(text.encode(encoding))
        with pytest.raises(ReadError):
            read_mesh(tmp_path / "f.vtu")


def test_what_a_collada_file_names_is_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import trimesh

    pytest.importorskip("collada")
    (tmp_path / "secret.png").write_bytes(b"not to be opened")
    trimesh.creation.box().export(tmp_path / "f.dae")
    text = (tmp_path / "f.dae").read_text()
    image = f'<image id="i"><init_from>{(tmp_path / "secret.png").as_uri()}</init_from></image>'
    image = f"<library_images>{image}</library_images>"
    (tmp_path / "f.dae").write_text(text.replace("<library_geometries>", f"{image}<library_geometries>"))
    assert "secret" in (tmp_path / "f.dae").read_text()
    opened = watch_opened(monkeypatch)
    assert len(read_mesh(tmp_path / "f.dae")[1]) == 12
    assert not [name for name in opened if "secret" in name]


def test_two_threads_read_meshes_and_change_nothing_of_the_process(tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    (tmp_path / "f.inp").write_text(PART)
    (tmp_path / "f.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    before = sys.stdout, logging.getLogger("trimesh").level
    with ThreadPoolExecutor(2) as pool:
        read = list(pool.map(read_mesh, [tmp_path / "f.inp", tmp_path / "f.obj"] * 20))
    assert (sys.stdout, logging.getLogger("trimesh").level) == before
    assert not logging.getLogger("trimesh").filters
    assert [len(faces) for _, faces in read] == [4, 1] * 20
