"""Volumes whose headers lie: sizes, other files, and compressed content that grows."""

from __future__ import annotations

import gzip
import io
from pathlib import Path

import numpy as np
import pytest

import topokit as tk
from topokit.adapters.voxels.files import read_volume
from topokit.errors import ReadError

pytest.importorskip("nibabel")
pytest.importorskip("nrrd")
pytest.importorskip("tifffile")
HEADER = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: {} {} {}\nencoding: {}\n{}\n"


def test_a_nifti_of_claimed_size_is_refused(tmp_path: Path) -> None:
    import nibabel

    image = bytearray(nibabel.Nifti1Image(np.zeros((4, 4, 4), dtype=np.uint8), np.eye(4)).to_bytes())
    image[42:48] = np.array([30_000] * 3, dtype="<i2").tobytes()
    (tmp_path / "f.nii").write_bytes(image)
    with pytest.raises(ReadError, match=r"announces an image of shape \(30000, 30000, 30000\)"):
        read_volume(tmp_path / "f.nii")


def test_a_tiff_of_claimed_size_is_refused(tmp_path: Path) -> None:
    import tifffile

    for compression in (None, "zlib"):
        target = io.BytesIO()
        tifffile.imwrite(target, np.zeros((3, 8, 8), dtype=np.uint8), compression=compression, metadata=None)
        content = target.getvalue()
        with tifffile.TiffFile(io.BytesIO(content)) as file:
            places = [page.tags[name].valueoffset for page in file.pages for name in ("ImageWidth", "ImageLength")]
        changed = bytearray(content)
        for place in places:
            changed[place : place + 4] = (10**6).to_bytes(4, "little")
        (tmp_path / "f.tif").write_bytes(changed)
        with pytest.raises(ReadError, match="announces 375000 strips of pixels"):
            read_volume(tmp_path / "f.tif")


@pytest.mark.parametrize("name", ["../secret.raw", "{folder}/secret.raw", "link.raw"])
def test_voxels_in_other_folders_are_not_opened(name: str, tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "secret.raw").write_bytes(bytes(8))
    (tmp_path / "inner" / "link.raw").symlink_to(tmp_path / "secret.raw")
    header = HEADER.format(2, 2, 2, "raw", f"data file: {name.format(folder=tmp_path)}\n")
    (tmp_path / "inner" / "f.nrrd").write_text(header)
    with pytest.raises(ReadError, match="which is not in its folder: it is not opened"):
        read_volume(tmp_path / "inner" / "f.nrrd")


def test_links_to_voxels_elsewhere_are_not_followed(tmp_path: Path) -> None:
    nibabel, _ = pytest.importorskip("nibabel"), pytest.importorskip("SimpleITK")
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "secret.raw").write_bytes(bytes(8))
    (inner / "link.raw").symlink_to(tmp_path / "secret.raw")
    fields = "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = link.raw\n"
    (inner / "a.mhd").write_text(fields)
    nibabel.save(nibabel.Nifti1Pair(np.zeros((2, 2, 2), np.uint8), np.eye(4)), inner / "b.hdr")
    (inner / "b.img").rename(tmp_path / "b.img")
    (inner / "b.img").symlink_to(tmp_path / "b.img")
    for name in ("a.mhd", "b.hdr"):
        with pytest.raises(ReadError, match="which is not in its folder: it is not opened"):
            read_volume(inner / name)
    (tmp_path / "linked.mhd").symlink_to(inner / "a.mhd")
    (inner / "link.raw").unlink()
    (inner / "link.raw").write_bytes(bytes(8))
    assert read_volume(inner / "a.mhd")[0].shape == (2, 2, 2)
    with pytest.raises(ReadError):  # SimpleITK would look beside the link
        read_volume(tmp_path / "linked.mhd")


def test_voxels_beside_the_header_are_read(tmp_path: Path) -> None:
    (tmp_path / "voxels.raw").write_bytes(bytes(range(8)))
    (tmp_path / "f.nhdr").write_text(HEADER.format(2, 2, 2, "raw", "data file: voxels.raw\n"))
    assert read_volume(tmp_path / "f.nhdr")[0].sum() == 28


@pytest.mark.parametrize("encoding", ["gzip", "bzip2"])
def test_compressed_voxels_that_grow_are_refused(
    encoding: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import bz2

    from topokit.adapters.voxels import bounds

    monkeypatch.setattr(bounds, "FREE_OF_MASKS", 1 << 20)
    packed = {"gzip": gzip.compress, "bzip2": bz2.compress}[encoding](bytes(4 << 20))
    (tmp_path / "f.nrrd").write_bytes(HEADER.format(2, 2, 2, encoding, "").encode() + packed)
    with pytest.raises(ReadError, match="decompression bomb"):
        read_volume(tmp_path / "f.nrrd")


def test_a_gzip_bomb_is_refused_by_any_reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from topokit.inputs import unpacking

    monkeypatch.setattr(unpacking, "FREE_OF_MASKS", 1 << 20)
    (tmp_path / "f.nii.gz").write_bytes(gzip.compress(bytes(344) + b"n+1\0" + bytes(8 << 20)))
    with pytest.raises(ReadError, match="decompression bomb"):
        tk.load(tmp_path / "f.nii.gz")
