"""Surfaces of neuroimaging: GIFTI in all encodings and FreeSurfer, intact, hostile and without triangles."""

from __future__ import annotations

import base64
import zlib
from pathlib import Path

import numpy as np
import pytest

import topokit as tk
from topokit.testing import torus_mesh

nibabel = pytest.importorskip("nibabel", reason="nibabel is not installed; make test installs it")

ENCODINGS = ("GIFTI_ENCODING_ASCII", "GIFTI_ENCODING_B64BIN", "GIFTI_ENCODING_B64GZ")


def gifti(*, encoding: str = ENCODINGS[1], with_faces: bool = True) -> bytes:
    vertices, faces = torus_mesh()
    intents = [
        ("NIFTI_INTENT_POINTSET", vertices.astype(np.float32)),
        ("NIFTI_INTENT_TRIANGLE", faces.astype(np.int32)),
    ]
    arrays = [
        nibabel.gifti.GiftiDataArray(data, intent=intent, encoding=encoding)
        for intent, data in intents[: 1 + with_faces]
    ]
    return bytes(nibabel.gifti.GiftiImage(darrays=arrays).to_bytes())


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_gifti(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "lh.surf.gii").write_bytes(gifti(encoding=encoding))
    report = tk.report(tmp_path / "lh.surf.gii")
    assert (report.genus, report.verdict) == (1, "certain")


def test_gifti_of_other_things_is_refused(tmp_path: Path) -> None:
    (tmp_path / "lh.gii").write_bytes(gifti(with_faces=False))
    with pytest.raises(tk.ReadError, match="1 arrays of points and 0 of triangles"):
        tk.load(tmp_path / "lh.gii")


def test_gifti_opens_no_other_file(tmp_path: Path) -> None:
    (tmp_path / "numbers").write_bytes(bytes(1 << 16))
    content = gifti().replace(b'ExternalFileName=""', b'ExternalFileName="numbers"')
    content = content.replace(b'Encoding="Base64Binary"', b'Encoding="ExternalFileBinary"')
    assert b"numbers" in content
    (tmp_path / "lh.gii").write_bytes(content)
    with pytest.raises(tk.ReadError, match=r"lh\.gii could not be read"):
        tk.load(tmp_path / "lh.gii")


def test_gifti_defines_no_entities(tmp_path: Path) -> None:
    content = gifti().replace(b'gifti.dtd">', b'gifti.dtd" [<!ENTITY a "aaaa">]>')
    assert b"ENTITY" in content
    (tmp_path / "lh.gii").write_bytes(content)
    with pytest.raises(tk.ReadError, match="XML entities"):
        tk.load(tmp_path / "lh.gii")


def test_gifti_that_expands_absurdly_is_refused(tmp_path: Path) -> None:
    bomb = base64.b64encode(zlib.compress(bytes(300 << 20), 9))
    start, _, rest = gifti(encoding=ENCODINGS[2]).partition(b"<Data>")
    (tmp_path / "lh.gii").write_bytes(start + b"<Data>" + bomb + rest[rest.index(b"</Data>") :])
    with pytest.raises(tk.ReadError, match="decompression bomb"):
        tk.load(tmp_path / "lh.gii")


def test_freesurfer(tmp_path: Path) -> None:
    vertices, faces = torus_mesh()
    nibabel.freesurfer.write_geometry(tmp_path / "lh.white", vertices, faces)
    report = tk.report(tmp_path / "lh.white")
    assert (report.genus, report.verdict) == (1, "certain")
    (tmp_path / "rh.white").write_bytes((tmp_path / "lh.white").read_bytes()[:-40])
    with pytest.raises(tk.ReadError, match="truncated"):
        tk.load(tmp_path / "rh.white")
