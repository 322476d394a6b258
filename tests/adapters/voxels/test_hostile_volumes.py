"""Volumes whose headers lie: sizes, other files, and compressed content that grows."""

from __future__ import annotations

import gzip
import io
import struct
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

    from topokit.adapters.voxels import announced_sizes

    monkeypatch.setattr(announced_sizes, "FREE_OF_MASKS", 1 << 20)
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


SECRET = bytes(range(8))


@pytest.fixture
def inner(tmp_path: Path) -> Path:
    """A folder, beside which lies secret.raw."""
    (tmp_path / "secret.raw").write_bytes(SECRET)
    (tmp_path / "inner").mkdir()
    return tmp_path / "inner"


@pytest.mark.parametrize(
    "line",
    [
        "ElementDataFile : {secret}\n",  # SimpleITK takes a colon for the equals sign
        "Comment : a = ElementDataFile = {secret}\n",
        "Comment = a\rElementDataFile = {secret}\n",
        "Comment = a\r\rElementDataFile : {secret}\r\n",
        "\x0bElementDataFile = {secret}\n",
    ],
)
def test_a_metaimage_has_one_place_for_its_voxels(line: str, inner: Path) -> None:
    pytest.importorskip("SimpleITK")
    start = "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\n"
    text = start + line.format(secret=inner.parent / "secret.raw") + "ElementDataFile = LOCAL\n"
    (inner / "f.mhd").write_bytes(text.encode() + bytes([7] * 8))
    with pytest.raises(ReadError, match="NAME = VALUE"):
        read_volume(inner / "f.mhd")


@pytest.mark.parametrize("order", [("data file", "datafile"), ("datafile", "data file")])
def test_a_nrrd_that_names_two_files_is_refused(order: tuple[str, str], inner: Path) -> None:
    (inner / "beside.raw").write_bytes(bytes(8))
    names = dict(zip(order, ("beside.raw", str(inner.parent / "secret.raw")), strict=True))
    lines = "".join(f"{key}: {name}\n" for key, name in names.items())
    (inner / "f.nhdr").write_text(HEADER.format(2, 2, 2, "raw", lines))
    with pytest.raises(ReadError, match="says twice where its voxels are"):
        read_volume(inner / "f.nhdr")


def test_a_link_to_a_header_does_not_move_its_voxels(inner: Path) -> None:
    """The voxels are those beside the header, not those beside the link, which is a link to elsewhere itself."""
    (inner.parent / "real").mkdir()
    (inner.parent / "real" / "f.nhdr").write_text(HEADER.format(2, 2, 2, "raw", "data file: v.raw\n"))
    (inner.parent / "real" / "v.raw").write_bytes(bytes([1] * 8))
    (inner / "f.nhdr").symlink_to(inner.parent / "real" / "f.nhdr")
    (inner / "v.raw").symlink_to(inner.parent / "secret.raw")
    assert read_volume(inner / "f.nhdr")[0].ravel().tolist() == [1] * 8


@pytest.mark.parametrize("name", ["LIST", "slice%02d.raw 1 2 1", "http://127.0.0.1/v.raw"])
def test_a_nrrd_of_many_files_or_of_the_net_is_refused(name: str, inner: Path) -> None:
    (inner / "f.nhdr").write_text(HEADER.format(2, 2, 2, "raw", f"data file: {name}\n"))
    with pytest.raises(ReadError, match=r"does not exist|not in its folder"):
        read_volume(inner / "f.nhdr")


def test_a_series_of_dicom_has_no_slice_elsewhere(inner: Path) -> None:
    itk = pytest.importorskip("SimpleITK")
    writer = itk.ImageFileWriter()
    for number in range(3):
        image = itk.GetImageFromArray(np.full((1, 4, 4), number, dtype=np.int16))
        for key, value in (("0020|000e", "1.2.3"), ("0020|0013", str(number)), ("0020|0032", f"0\\0\\{number}")):
            image.SetMetaData(key, value)
        writer.KeepOriginalImageUIDOn()
        writer.SetFileName(str(inner / f"{number}.dcm"))
        writer.Execute(image)
    assert read_volume(inner)[0].shape == (4, 4, 3)
    (inner / "2.dcm").rename(inner.parent / "private.dcm")
    (inner / "2.dcm").symlink_to(inner.parent / "private.dcm")
    with pytest.raises(ReadError, match=r"holds the link '2.dcm' to a file elsewhere"):
        read_volume(inner)


def ndtiff(value: int) -> tuple[bytes, int]:
    """A TIFF of 8 × 8 bytes with the header of NDTiff 3, and where its bytes lie."""
    header = struct.pack("<IIII", 483729, 3, 2355492, 2) + b"{}"
    tags = {256: 8, 257: 8, 258: 8, 259: 1, 262: 1, 273: 200, 277: 1, 278: 8, 279: 64}
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, number) for tag, number in tags.items())
    entries += struct.pack("<HHII", 51123, 2, 8, 180)  # a text of 8 bytes there: metadata of Micro-Manager
    content = b"II*\0" + struct.pack("<I", 26) + header + struct.pack("<H", len(tags) + 1) + entries + bytes(4)
    return content.ljust(180, b"\0") + b"{}".ljust(20, b"\0") + bytes([value] * 64), 200


def test_an_index_beside_a_tiff_opens_no_other_one(inner: Path) -> None:
    import tifffile

    (inner / "a_NDTiffStack.tif").write_bytes(ndtiff(1)[0])
    content, offset = ndtiff(9)
    (inner.parent / "secret.tif").write_bytes(content)
    for name in ("../secret.tif", str(inner.parent / "secret.tif")):
        rows = []
        for z in range(2):
            axes, file = f'{{"z": {z}}}'.encode(), name.encode()
            numbers = struct.pack("<8I", offset, 8, 8, 0, 0, 0, 0, 0)
            rows.append(struct.pack("<I", len(axes)) + axes + struct.pack("<I", len(file)) + file + numbers)
        (inner / "NDTiff.index").write_bytes(b"".join(rows))
        followed = tifffile.imread(inner / "a_NDTiffStack.tif")
        assert np.unique(followed).tolist() == [9]  # by itself tifffile opens the other file
        with pytest.raises(ReadError, match=r"shape \(8, 8\); a volume"):  # its own page alone
            read_volume(inner / "a_NDTiffStack.tif")


def test_the_parts_of_an_ome_tiff_are_not_looked_for(inner: Path) -> None:
    import tifffile

    tifffile.imwrite(inner.parent / "secret.ome.tif", np.full((2, 8, 8), 9, dtype=np.uint8), metadata={"axes": "ZYX"})
    uuid = '<UUID FileName="../secret.ome.tif">urn:uuid:2</UUID>'
    text = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" UUID="urn:uuid:1">'
        '<Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint8" SizeX="8" SizeY="8" SizeZ="2" '
        f'SizeC="1" SizeT="1"><TiffData IFD="0" FirstZ="0" PlaneCount="2">{uuid}</TiffData></Pixels></Image></OME>'
    )
    pages = np.ones((2, 8, 8), dtype=np.uint8)
    tifffile.imwrite(inner / "f.ome.tif", pages, description=text, metadata=None)
    array, _ = read_volume(inner / "f.ome.tif")
    assert np.unique(array).tolist() == [1]
