"""Small valid files of every format that topokit reads, as bytes: what the fuzzer damages.

Every writer is given random numbers, so that sizes, types and options of a format vary from file to file.
"""

from __future__ import annotations

import functools
import gzip
import io
import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from splat_writers import (
    Scene,
    join_spz_4,
    random_scene,
    sog_members,
    spz_streams,
    write_compressed_ply,
    write_ksplat,
    write_splat,
    zip_members,
)
from splat_writers import write_ply as write_splat_ply
from write_test_files import ascii_stl, cube, obj, off, ply, stl

from topokit.testing import icosphere, torus_mesh
from topokit.testing.meshes import Mesh

Rng = np.random.Generator
Writer = Callable[[Rng], bytes]


def _mesh(rng: Rng) -> Mesh:
    return (icosphere(0), icosphere(1), torus_mesh(6, 4), cube())[int(rng.integers(4))]


def _triangles(rng: Rng) -> Mesh:
    return (icosphere(0), icosphere(1), torus_mesh(6, 4))[int(rng.integers(3))]


def _cloud(rng: Rng) -> NDArray[np.float64]:
    return rng.normal(size=(int(rng.integers(8, 40)), int(rng.choice([3, 6]))))


def _volume(rng: Rng) -> NDArray[np.generic]:
    kind = rng.choice(["u1", "i2", "f4", "f8"])
    return (rng.random(rng.integers(2, 7, size=3)) * 200).astype(kind)


def ascii_ply(rng: Rng) -> bytes:
    vertices, faces = _mesh(rng)
    header = f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [" ".join(f"{x:.5g}" for x in row) for row in vertices]
    rows += [" ".join(map(str, (len(face), *face))) for face in faces]
    return (header + "\n".join(rows) + "\n").encode()


def points_ply(rng: Rng) -> bytes:
    points = _cloud(rng)
    kind, code = [("float", "f4"), ("double", "f8")][int(rng.integers(2))]
    names = ("x", "y", "z", "nx", "ny", "nz")[: points.shape[1]]
    order = rng.choice(["little", "big"])
    header = f"ply\nformat binary_{order}_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property {kind} {name}\n" for name in names) + "end_header\n"
    return header.encode() + points.astype((">" if order == "big" else "<") + code).tobytes()


def gltf_parts(rng: Rng) -> tuple[dict[str, object], bytes]:
    """The JSON and the buffer of a glTF scene with one mesh under two nodes."""
    vertices, faces = _triangles(rng)
    positions, indices = vertices.astype("<f4").tobytes(), faces.astype("<u2").tobytes()
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": len(positions)},
        {"buffer": 0, "byteOffset": len(positions), "byteLength": len(indices)},
    ]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": faces.size, "type": "SCALAR"},
    ]
    scene: dict[str, object] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1, 2]}, {"mesh": 0}, {"mesh": 0, "translation": [3, 0, 0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(positions) + len(indices)}],
    }
    return scene, positions + indices


def glb_of(scene: object, buffer: bytes) -> bytes:
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    buffer += b"\0" * (-len(buffer) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def three_mf_members(rng: Rng) -> dict[str, bytes]:
    vertices, faces = _triangles(rng)
    points = "".join(f'<vertex x="{x:.4f}" y="{y:.4f}" z="{z:.4f}"/>' for x, y, z in vertices)
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    model = (
        '<?xml version="1.0" encoding="UTF-8"?><model unit="millimeter" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources><object id="1" type="model">'
        f"<mesh><vertices>{points}</vertices><triangles>{triangles}</triangles></mesh></object>"
        '<object id="2"><components><component objectid="1"/></components></object></resources>'
        '<build><item objectid="2"/></build></model>'
    )
    kinds = (
        '<?xml version="1.0"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types"><Default '
        'Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
    )
    return {"[Content_Types].xml": kinds.encode(), "3D/3dmodel.model": model.encode()}


def text_cloud(rng: Rng) -> bytes:
    separator = str(rng.choice([" ", ",", ";", "\t"]))
    lines = [separator.join(f"{x:.5f}" for x in row) for row in _cloud(rng)]
    return ("# points\n" * int(rng.integers(2)) + "\n".join(lines) + "\n").encode()


def npy(array: NDArray[np.generic]) -> bytes:
    target = io.BytesIO()
    np.save(target, array)
    return target.getvalue()


def npz(rng: Rng, **arrays: NDArray[np.generic]) -> bytes:
    target = io.BytesIO()
    (np.savez_compressed if rng.random() < 0.5 else np.savez)(target, **arrays)
    return target.getvalue()


def pcd(rng: Rng) -> bytes:
    import pypcd4

    kinds = [pypcd4.Encoding.ASCII, pypcd4.Encoding.BINARY, pypcd4.Encoding.BINARY_COMPRESSED]
    cloud = pypcd4.PointCloud.from_xyz_points(_cloud(rng)[:, :3].astype(np.float32))
    target = io.BytesIO()
    cloud.save(target, encoding=kinds[int(rng.integers(3))])
    return target.getvalue()


def las(rng: Rng, suffix: str) -> bytes:
    import laspy

    kind = int(rng.choice([0, 1, 3, 6, 7]))
    found = laspy.create(point_format=kind, file_version="1.4" if kind > 5 else "1.2")
    points = _cloud(rng)
    found.header.scales = (0.001, 0.001, 0.001)
    found.x, found.y, found.z = points[:, :3].T
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"f{suffix}"
        found.write(str(path))
        return path.read_bytes()


def parquet(rng: Rng) -> bytes:
    import pyarrow
    from pyarrow.parquet import write_table

    points, target = _cloud(rng), io.BytesIO()
    columns = dict(zip(("x", "y", "z", "nx", "ny", "nz"), points.T, strict=False))
    packing = str(rng.choice(["snappy", "zstd", "none"]))
    write_table(pyarrow.table(columns), target, row_group_size=int(rng.integers(4, 50)), compression=packing)
    return target.getvalue()


def nifti(rng: Rng) -> bytes:
    import nibabel

    kind = nibabel.Nifti1Image if rng.random() < 0.7 else nibabel.Nifti2Image
    affine = np.diag([*rng.uniform(0.5, 2, size=3), 1.0])
    return bytes(kind(_volume(rng), affine).to_bytes())


def mgh(rng: Rng) -> bytes:
    import nibabel

    volume = _volume(rng)
    kept = volume if volume.dtype.itemsize < 8 else volume.astype(np.float32)
    return bytes(nibabel.MGHImage(kept, np.diag([*rng.uniform(0.5, 2, size=3), 1.0])).to_bytes())


def mrc(rng: Rng) -> bytes:
    import mrcfile

    with TemporaryDirectory() as folder:
        with mrcfile.new(Path(folder) / "f.mrc", _volume(rng).astype(np.int16)) as file:
            file.voxel_size = tuple(rng.uniform(0.5, 2, size=3))
        return (Path(folder) / "f.mrc").read_bytes()


def vti(rng: Rng) -> bytes:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    volume, image, writer = _volume(rng), vtkImageData(), vtkXMLImageDataWriter()
    values = numpy_to_vtk(volume.ravel(order="F"), deep=True)
    values.SetName("gray")
    image.SetDimensions(*volume.shape)
    image.GetPointData().AddArray(values)
    writer.SetInputData(image)
    (writer.SetDataModeToAscii, writer.SetDataModeToBinary, writer.SetDataModeToAppended)[int(rng.integers(3))]()
    writer.SetEncodeAppendedData(bool(rng.integers(2)))
    (writer.SetCompressorTypeToNone, writer.SetCompressorTypeToZLib)[int(rng.integers(2))]()
    with TemporaryDirectory() as folder:
        writer.SetFileName(f"{folder}/f.vti")
        writer.Write()
        return (Path(folder) / "f.vti").read_bytes()


def gifti(rng: Rng) -> bytes:
    from nibabel.gifti import GiftiDataArray, GiftiImage

    vertices, faces = _triangles(rng)
    encoding = str(rng.choice(["GIFTI_ENCODING_ASCII", "GIFTI_ENCODING_B64BIN", "GIFTI_ENCODING_B64GZ"]))
    parts = (("POINTSET", np.asarray(vertices, np.float32)), ("TRIANGLE", np.asarray(faces, np.int32)))
    arrays = [GiftiDataArray(data, intent=f"NIFTI_INTENT_{name}", encoding=encoding) for name, data in parts]
    return bytes(GiftiImage(darrays=arrays).to_bytes())


def freesurfer(rng: Rng) -> bytes:
    from nibabel.freesurfer import write_geometry

    with TemporaryDirectory() as folder:
        write_geometry(Path(folder) / "f", *map(np.asarray, _triangles(rng)))
        return (Path(folder) / "f").read_bytes()


def nrrd(rng: Rng) -> bytes:
    import nrrd as pynrrd

    header = {"encoding": str(rng.choice(["raw", "gzip", "ascii", "bzip2"]))}
    if rng.random() < 0.5:
        header |= {"space directions": np.diag(rng.uniform(0.5, 2, size=3)), "space dimension": 3}
    target = io.BytesIO()
    pynrrd.write(target, _volume(rng), header)
    return target.getvalue()


def tiff(rng: Rng) -> bytes:
    import tifffile

    target = io.BytesIO()
    compression = "zlib" if rng.random() < 0.5 else None
    tifffile.imwrite(target, _volume(rng).astype(np.uint8), compression=compression, photometric="minisblack")
    return target.getvalue()


@functools.cache
def _script() -> bytes:
    """Traced once: torch keeps 0.17 MiB of every trace."""
    import torch

    target = io.BytesIO()
    network = torch.nn.Sequential(torch.nn.Linear(3, 4), torch.nn.ReLU(), torch.nn.Linear(4, 1))
    torch.jit.save(torch.jit.trace(network, torch.ones(2, 3)), target)
    return target.getvalue()


@functools.cache
def _export() -> bytes:
    import torch

    target = io.BytesIO()
    count = torch.export.Dim("count")
    program = torch.export.export(torch.nn.Linear(3, 1), (torch.ones(5, 3),), dynamic_shapes=({0: count},))
    torch.export.save(program, target)
    return target.getvalue()


def script_members() -> dict[str, bytes]:
    return _members(_script())


def export_members() -> dict[str, bytes]:
    return _members(_export())


def _members(archive: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(archive)) as found:
        return {name: found.read(name) for name in found.namelist()}


def _splats(write: Callable[..., None], **options: object) -> Writer:
    def written(rng: Rng) -> bytes:
        with TemporaryDirectory() as folder:
            write(Path(folder) / "f", _scene(rng), **options)
            return (Path(folder) / "f").read_bytes()

    return written


def _scene(rng: Rng) -> Scene:
    return random_scene(int(rng.integers(1, 24)), int(rng.integers(1 << 30)))


def spz_parts(rng: Rng, version: int) -> tuple[bytes, list[bytes]]:
    return spz_streams(_scene(rng), version, sh_degree=int(rng.integers(3)))


def spz_body(rng: Rng) -> bytes:
    """Versions 1 to 3 before they are gzipped."""
    header, streams = spz_parts(rng, int(rng.integers(1, 4)))
    return header + b"".join(streams)


def packed(content: bytes) -> bytes:
    return gzip.compress(content, 1)


FLAT: dict[str, tuple[str, Writer]] = {
    "obj": ("f.obj", lambda rng: obj(_mesh(rng))),
    "off": ("f.off", lambda rng: off(_mesh(rng))),
    "stl": ("f.stl", lambda rng: stl(_triangles(rng))),
    "stl as text": ("f.stl", lambda rng: ascii_stl(_triangles(rng))),
    "ply": ("f.ply", lambda rng: ply(_mesh(rng))),
    "ply as text": ("f.ply", ascii_ply),
    "text": ("f.xyz", text_cloud),
    "npy points": ("f.npy", lambda rng: npy(_cloud(rng))),
    "ply points": ("f.ply", points_ply),
    "pcd": ("f.pcd", pcd),
    "las": ("f.las", lambda rng: las(rng, ".las")),
    "laz": ("f.laz", lambda rng: las(rng, ".laz")),
    "parquet": ("f.parquet", parquet),
    "npy volume": ("f.npy", lambda rng: npy(_volume(rng))),
    "nii": ("f.nii", nifti),
    "mgh": ("f.mgh", mgh),
    "mrc": ("f.mrc", mrc),
    "vti": ("f.vti", vti),
    "gifti": ("f.gii", gifti),
    "freesurfer": ("f.white", freesurfer),
    "nrrd": ("f.nrrd", nrrd),
    "tif": ("f.tif", tiff),
    "3dgs": ("f.ply", _splats(write_splat_ply)),
    "3dgs as text": ("f.ply", _splats(write_splat_ply, style="ascii")),
    "compressed ply": ("f.ply", _splats(write_compressed_ply)),
    "splat": ("f.splat", _splats(write_splat)),
    "ksplat": ("f.ksplat", _splats(write_ksplat, level=1)),
    "spz 4": ("f.spz", lambda rng: join_spz_4(*spz_parts(rng, 4))),
}
"""Name in a folder and writer of formats that are damaged byte by byte."""

ZIPPED: dict[str, tuple[str, Callable[[Rng], dict[str, bytes]]]] = {
    "3mf": ("f.3mf", three_mf_members),
    "npz points": ("f.npz", lambda rng: _members(npz(rng, points=_cloud(rng)))),
    "npz volume": ("f.npz", lambda rng: _members(npz(rng, volume=_volume(rng), spacing=np.ones(3)))),
    "sog": ("f.sog", lambda rng: sog_members(_scene(rng))),
    "TorchScript": ("f.pt", lambda rng: script_members()),
    "torch.export": ("f.pt2", lambda rng: export_members()),
}
"""The same for archives, whose members are damaged before they are packed."""

GZIPPED: dict[str, tuple[str, Writer]] = {"nii.gz": ("f.nii.gz", nifti), "spz": ("f.spz", spz_body)}
"""Formats that are damaged before they are compressed."""

__all__ = ["FLAT", "GZIPPED", "ZIPPED", "Rng", "Writer", "glb_of", "gltf_parts", "packed", "zip_members"]
