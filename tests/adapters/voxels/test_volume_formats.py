"""Volumes as scanners and microscopes write them: voxel sizes, scaling, series, and images of other libraries."""

from __future__ import annotations

import base64
import locale
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.errors import InputError, ReadError

RING = np.zeros((9, 8, 5), dtype=np.int16)
RING[1:8, 1:7, 1:4] = 1
RING[3:6, 3:5] = 0
SIZES = (1.0, 2.0, 3.0)


def check(shape: tk.Shape, spacing: tuple[float, ...] = SIZES, extents: tuple[int, ...] = RING.shape) -> None:
    assert shape.genus() == 1
    assert shape.field.grid.shape == extents
    assert shape.field.grid.spacing == pytest.approx(spacing)


def test_several_labels_are_one_solid() -> None:
    labels = RING.copy()
    labels[3:6, 3:5, 1:4] = 2
    for both in ([1, 2], (2, 1), {1, 2}, np.array([1, 2]), torch.tensor([1, 2]), range(1, 3)):
        shape = tk.from_voxels(labels, label=both)
        assert shape.genus() == 0
        assert "The solid is the voxels with label 1 or 2." in shape.report().reasons
    assert tk.from_voxels(labels, label=[1]).genus() == 1
    assert "No voxel has the label 9." in tk.from_voxels(labels, label=[1, 9]).report().reasons
    assert float(tk.from_voxels(labels, label=[1, 2]).smoothed_euler(0.0)) == 2


def test_nifti_takes_slope_and_sform(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel", reason="nibabel is not installed; make test installs it")
    image = nibabel.Nifti1Image(RING, np.diag([*SIZES, 1]))
    image.header.set_slope_inter(2, 10)
    nibabel.save(image, tmp_path / "a.nii.gz")
    check(tk.load(tmp_path / "a.nii.gz", level=11))
    assert float(tk.load(tmp_path / "a.nii.gz", level=11).field.volume.max()) == 12
    turned = np.eye(4)
    turned[:3, :3] = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]) * SIZES
    image = nibabel.Nifti1Image(RING, turned)
    image.header["pixdim"][1:4] = 1  # the sform is right and this is not
    nibabel.save(image, tmp_path / "b.nii")
    check(tk.load(tmp_path / "b.nii"))
    check(tk.load(image))
    check(tk.from_voxels(image, spacing=4.0), (4.0, 4.0, 4.0))
    nibabel.save(nibabel.Nifti1Pair(RING, np.diag([*SIZES, 1])), tmp_path / "pair.hdr")
    check(tk.load(tmp_path / "pair.hdr"))
    check(tk.load(tmp_path / "pair.img"))


def test_mgz_is_placed_by_its_affine(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel", reason="nibabel is not installed; make test installs it")
    affine = np.diag([*SIZES, 1])
    affine[:3, 3] = 10, 20, -30
    for name in ("a.mgz", "b.mgh"):
        nibabel.save(nibabel.MGHImage(RING, affine), tmp_path / name)
        shape = tk.load(tmp_path / name)
        check(shape)
        [handle] = shape.report(locate=True).location.handles
        place = handle.place
        assert (place.unit, place.space) == ("mm", "RAS")
        assert place.world == pytest.approx(affine[:3, :3] @ place.voxel + affine[:3, 3], abs=2)


@pytest.mark.parametrize("placed_by", ["origin", "start"])
def test_mrc_has_its_axes_in_the_order_of_its_header(placed_by: str, tmp_path: Path) -> None:
    mrcfile = pytest.importorskip("mrcfile", reason="mrcfile is not installed; make test installs it")
    with mrcfile.new(tmp_path / "a.mrc", RING) as file:  # sections along x, rows along z, columns along y
        header = file.header
        header.maps, header.mapr, header.mapc = 1, 3, 2
        header.mx, header.my, header.mz = 9, 5, 8
        header.cella = (9 * 1.0, 5 * 3.0, 8 * 2.0)
        if placed_by == "origin":
            header.origin = (7.0, 12.0, 6.0)
        else:
            header.nzstart, header.nystart, header.nxstart = 7, 3, 4
    shape = tk.load(tmp_path / "a.mrc")
    check(shape)
    [handle] = shape.report(locate=True).location.handles
    x, z, y = handle.place.voxel
    assert (handle.place.unit, handle.place.world) == ("Å", pytest.approx((7 + x, 12 + 3 * y, 6 + 2 * z), abs=2))


def write_vti(path: Path, mode: str = "Appended", **arrays: np.ndarray) -> np.ndarray:
    """Write arrays of points (or of cells, called cells…) of a turned image whose first index is not 0; its affine."""
    pytest.importorskip("vtkmodules", reason="vtk is not installed; make test installs it")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    image, directions = vtkImageData(), np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    n_points = np.max([np.add(one.shape[:3], name.startswith("cells")) for name, one in arrays.items()], axis=0)
    image.SetExtent(*np.column_stack(((2, 0, -1), n_points + np.array((1, -1, -2)))).ravel().tolist())
    image.SetSpacing(SIZES)
    image.SetOrigin(10, 20, 30)
    image.SetDirectionMatrix(*directions.ravel())
    for name, one in arrays.items():
        flat = one.reshape(-1, *one.shape[3:], order="F")
        vtk_array = numpy_to_vtk(flat, deep=True)
        vtk_array.SetName(name)
        (image.GetCellData() if name.startswith("cells") else image.GetPointData()).AddArray(vtk_array)
    writer = vtkXMLImageDataWriter()
    getattr(writer, f"SetDataModeTo{mode}")()
    writer.SetFileName(str(path))
    writer.SetInputData(image)
    assert writer.Write()
    affine = np.eye(4)
    affine[:3, :3] = directions * SIZES
    affine[:3, 3] = (10, 20, 30) + affine[:3, :3] @ (2, 0, -1)
    return affine


@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended"])
@pytest.mark.parametrize("where", ["points", "cells"])
def test_vti_is_placed_by_extent_origin_spacing_and_direction(mode: str, where: str, tmp_path: Path) -> None:
    affine = write_vti(tmp_path / "a.vti", mode, **{where: RING})
    shape = tk.load(tmp_path / "a.vti")
    check(shape)
    assert shape.field.volume.numpy().tolist() == RING.tolist()
    [handle] = shape.report(locate=True).location.handles
    index = np.add(handle.place.voxel, 0.5 * (where == "cells"))
    assert handle.place.world == pytest.approx(affine[:3, :3] @ index + affine[:3, 3], abs=2)
    blocks = tk.from_voxels(tmp_path / "a.vti", block_voxels=100).report()
    assert (blocks.solid_betti, blocks.genus) == ((1, 1, 0), 1)


def test_arrays_of_vti_are_chosen_by_path_and_channel(tmp_path: Path) -> None:
    path = tmp_path / "a.vti"
    write_vti(path, points=np.ones_like(RING), cells=RING[1:, 1:, 1:], vectors=np.stack((RING * 0, RING), axis=3))
    with pytest.raises(InputError, match=r"PointData/points \(9, 8, 5\).*CellData/cells \(8, 7, 4\): pass dataset"):
        tk.load(path)
    assert tk.load(path, dataset="CellData/cells").genus() == 1
    assert tk.load(path, dataset="PointData/points").genus() == 0
    assert tk.load(path, dataset="PointData/vectors", channel=1).genus() == 1
    layer = tk.load(path, dataset="PointData/vectors", axis="x", channel=3).field.volume
    assert layer.numpy().tolist() == np.stack((RING[3] * 0, RING[3]), axis=2).tolist()
    with pytest.raises(InputError, match=r"with the axes x, y, z, c\. Of several"):
        tk.load(path, dataset="PointData/vectors")
    with pytest.raises(ReadError, match=r"no array 'points'\. It holds PointData/points"):
        tk.load(path, dataset="points")


def test_damaged_vti_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.vti"
    write_vti(path, "Ascii", points=RING)
    content = path.read_bytes()
    for damaged, message in (
        (content[:-300], "could not be read by VTK"),
        (content.replace(b'WholeExtent="2 10', b'WholeExtent="2 1'), "it has no points"),
        (content.replace(b'WholeExtent="2 10', b'WholeExtent="2 11'), "its pieces are not the whole image"),
        (content.replace(b'"2 10 0 7 -1 3"', b'"2 90001 0 70007 -1 300003"'), "decompression bomb"),
        (content.replace(b"</Piece>", b""), "mismatched tag"),
    ):
        path.write_bytes(damaged)
        with pytest.raises(ReadError, match=message):
            tk.load(path)


def test_compressed_blocks_of_vti_are_no_larger_than_their_file_can_hold(tmp_path: Path) -> None:
    path = tmp_path / "a.vti"
    for mode, before in (("Binary", rb"<DataArray.*?>\s*"), ("Appended", rb"<AppendedData[^_]*_")):
        write_vti(path, mode, points=RING)
        content = path.read_bytes()
        start = re.search(before, content)
        for words, message in (((1, 2**32 - 1), "decompression bomb"), ((2**31, 1), "2147483648 compressed blocks")):
            header = base64.b64encode(np.array((*words, 720), "<u4").tobytes())
            path.write_bytes(content[: start.end()] + header + content[start.end() + 16 :])
            with pytest.raises(ReadError, match=message):
                tk.load(path)


def test_nrrd_takes_space_directions(tmp_path: Path) -> None:
    nrrd = pytest.importorskip("nrrd", reason="pynrrd is not installed; make test installs it")
    header = {"space": "left-posterior-superior", "space directions": np.diag(SIZES)}
    for name in ("a.nrrd", "b.nhdr"):
        nrrd.write(str(tmp_path / name), RING, header)
        check(tk.load(tmp_path / name))


def test_tiff_takes_the_sizes_of_imagej_and_ome(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile", reason="tifffile is not installed; make test installs it")
    stack = RING.astype(np.uint8)
    tifffile.imwrite(
        tmp_path / "a.tif", stack, imagej=True, resolution=(1 / 3, 1 / 2), metadata={"spacing": 1.0, "axes": "ZYX"}
    )
    check(tk.load(tmp_path / "a.tif"))
    sizes = {"PhysicalSizeX": 3000.0, "PhysicalSizeXUnit": "nm", "PhysicalSizeY": 2.0, "PhysicalSizeZ": 1.0}
    tifffile.imwrite(tmp_path / "b.ome.tif", stack, metadata={"axes": "ZYX", **sizes})
    check(tk.load(tmp_path / "b.ome.tif"), (1000.0, 2000.0, 3000.0))
    tifffile.imwrite(tmp_path / "c.tif", stack)
    check(tk.load(tmp_path / "c.tif"), (1.0, 1.0, 1.0))
    tifffile.imwrite(tmp_path / "d.tif", np.zeros((5, 9, 9, 3), np.uint8), photometric="rgb")
    with pytest.raises(ReadError, match="Of several channels or times"):
        tk.load(tmp_path / "d.tif")


def metaimage(**changes: str) -> bytes:
    fields = {
        "ObjectType": "Image",
        "NDims": "3",
        "ElementSpacing": "1 2 3",
        "DimSize": "9 8 5",
        "ElementType": "MET_SHORT",
    }
    last = {"ElementDataFile": changes.pop("ElementDataFile", "LOCAL")}
    return "".join(f"{key} = {value}\n" for key, value in {**fields, **changes, **last}.items()).encode()


def test_metaimage(tmp_path: Path) -> None:
    pytest.importorskip("SimpleITK", reason="SimpleITK is not installed; make test installs it")
    values = RING.transpose().tobytes()
    (tmp_path / "a.mha").write_bytes(metaimage() + values)
    check(tk.load(tmp_path / "a.mha"))
    (tmp_path / "b.raw").write_bytes(values)
    (tmp_path / "b.mhd").write_bytes(metaimage(ElementDataFile="b.raw"))
    check(tk.load(tmp_path / "b.mhd"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (metaimage(DimSize="9000 9000 9000") + b"1234", "announces 729000000000 voxels"),
        (metaimage(DimSize="900000 900000 9", CompressedData="True") + b"1234", "decompression bomb"),
        (metaimage(ElementDataFile="/etc/passwd"), "the plain name of one file beside it was expected"),
        (metaimage(ElementDataFile="../b.raw"), "the plain name of one file beside it was expected"),
        (metaimage(ElementDataFile="b%03d.raw 1 5 1"), "the plain name of one file beside it was expected"),
        (metaimage(ElementDataFile="gone.raw"), "does not exist"),
    ],
)
def test_metaimages_that_are_dangerous_are_refused(content: bytes, message: str, tmp_path: Path) -> None:
    pytest.importorskip("SimpleITK", reason="SimpleITK is not installed; make test installs it")
    (tmp_path / "a.mha").write_bytes(content)
    with pytest.raises(ReadError, match=message):
        tk.load(tmp_path / "a.mha")


def write_series(folder: Path, series: str = "1.2.3") -> list[Path]:
    """A DICOM series whose files are named against the order of their slices."""
    itk: Any = pytest.importorskip("SimpleITK", reason="SimpleITK is not installed; make test installs it")
    folder.mkdir(exist_ok=True)
    paths = []
    for number in range(RING.shape[2]):
        image = itk.GetImageFromArray(RING[:, :, number].transpose())
        image.SetSpacing(SIZES[:2])
        tags = {
            "0020|000e": series,
            "0020|000d": "1.2",
            "0008|0060": "CT",
            "0020|0032": f"0\\0\\{3 * number}",
            "0020|0037": "1\\0\\0\\0\\1\\0",
            "0020|0013": str(number),
            "0018|0050": "3",
        }
        for key, value in tags.items():
            image.SetMetaData(key, value)
        paths.append(folder / f"{series}-{9 - number}.dcm")
        writer = itk.ImageFileWriter()
        writer.KeepOriginalImageUIDOn()
        writer.SetFileName(str(paths[-1]))
        writer.Execute(image)
    return paths


def test_a_dicom_series_is_its_folder(tmp_path: Path) -> None:
    before = locale.setlocale(locale.LC_ALL)
    paths = write_series(tmp_path / "series")
    locale.setlocale(locale.LC_ALL, before)  # which writing sets to "C"
    check(tk.load(tmp_path / "series"))
    check(tk.from_voxels(tmp_path / "series"))
    assert locale.setlocale(locale.LC_ALL) == before
    assert [row["genus"] for row in tk.survey(tmp_path)] == [1]
    with pytest.raises(ReadError, match="is one slice of 9 × 8 pixels: give the folder with its series"):
        tk.load(paths[0])
    write_series(tmp_path / "series", "1.2.4")
    locale.setlocale(locale.LC_ALL, before)
    with pytest.raises(ReadError, match="holds 2 DICOM series; put each into a folder of its own"):
        tk.load(tmp_path / "series")


def test_an_image_of_simpleitk() -> None:
    itk: Any = pytest.importorskip("SimpleITK", reason="SimpleITK is not installed; make test installs it")
    image = itk.GetImageFromArray(RING.transpose())
    image.SetSpacing(SIZES)
    check(tk.load(image))
    with pytest.raises(ReadError, match="3 numbers in each voxel"):
        tk.from_voxels(itk.Compose(image, image, image))


def test_an_image_of_monai() -> None:
    """A tensor with an affine, channel first, as `monai.data.MetaTensor`."""
    values = torch.from_numpy(RING).float().clone()[None]
    values.affine = torch.diag(torch.tensor([*SIZES, 1.0]))  # type: ignore[attr-defined]
    check(tk.from_voxels(values))
    two = torch.cat((values, values))
    two.affine = values.affine  # type: ignore[attr-defined]
    with pytest.raises(InputError, match="the image has 2 channels: pass channel=0"):
        tk.from_voxels(two)


def test_an_affine_that_was_never_filled_in_is_ignored() -> None:
    image = SimpleNamespace(dataobj=RING, affine=np.zeros((4, 4)))
    check(tk.from_voxels(image), (1.0, 1.0, 1.0))
