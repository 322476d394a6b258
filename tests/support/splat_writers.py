"""Minimal writers, one per splat format, so that tests need no file that somebody else made."""

from __future__ import annotations

import gzip
import io
import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
RUB = np.array([1, -1, -1])  # .spz has its axes half a turn around x away from those of .ply


class Scene(NamedTuple):
    """Linear scales, unit quaternions wxyz, opacities 0 … 1."""

    means: Floats
    scales: Floats
    quaternions: Floats
    opacities: Floats


def random_scene(n_splats: int, seed: int = 0) -> Scene:
    """Splats in a box of side 4, flat, with any rotation."""
    rng = np.random.default_rng(seed)
    quaternions = rng.normal(size=(n_splats, 4))
    scales = np.exp(rng.uniform(-4, -2, size=(n_splats, 3))) * [1, 1, 0.1]
    return Scene(
        rng.uniform(-2, 2, size=(n_splats, 3)),
        scales,
        quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True),
        rng.uniform(0.2, 0.99, size=n_splats),
    )


def torus_scene(n_splats: int = 4000, major: float = 1.0, minor: float = 0.4, seed: int = 0) -> Scene:
    """Discs tangent to a torus around z, with random spin and either side up."""
    from scipy.spatial.transform import Rotation

    from topokit.testing import torus_samples

    samples = torus_samples(n_splats, major, minor)
    rng = np.random.default_rng(seed)
    normals = samples.normals.numpy() * rng.choice([-1.0, 1.0], size=(n_splats, 1))
    helper = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    spin = rng.uniform(0, 2 * np.pi, size=(n_splats, 1))
    first = np.cos(spin) * first + np.sin(spin) * np.cross(normals, first)
    axes = np.stack((first, np.cross(normals, first), normals), axis=2)
    spacing = np.sqrt(samples.area / n_splats)
    scales = np.stack((*rng.uniform(0.6, 0.9, size=(2, n_splats)) * spacing, np.full(n_splats, 0.03 * spacing)), axis=1)
    quaternions = Rotation.from_matrix(axes).as_quat()[:, [3, 0, 1, 2]]
    return Scene(samples.points.numpy(), scales, quaternions, rng.uniform(0.6, 1, size=n_splats))


def write_ply(
    path: Path, scene: Scene, n_scales: int = 3, kind: str = "float", style: str = "binary_little_endian"
) -> None:
    """3DGS or (two scales) 2DGS, with nonsense for normals and unnormalized rotations, in any .ply encoding."""
    n_splats = len(scene.means)
    rng = np.random.default_rng(1)
    with np.errstate(divide="ignore"):
        columns = {
            **{axis: scene.means[:, i] for i, axis in enumerate("xyz")},
            **{
                axis: rng.normal(size=n_splats) for axis in ("nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0")
            },
            "opacity": np.log(scene.opacities / (1 - scene.opacities)),
            **{f"scale_{i}": np.log(scene.scales[:, i]) for i in range(n_scales)},
            **{f"rot_{i}": scene.quaternions[:, i] * 1.7 for i in range(4)},
        }
    header = f"ply\nformat {style} 1.0\ncomment made by a test\nelement vertex {n_splats}\n"
    header += "".join(f"property {kind} {name}\n" for name in columns) + "end_header\n"
    if style == "ascii":
        rows = "\n".join(" ".join(f"{value:.9g}" for value in row) for row in np.stack(list(columns.values()), axis=1))
        path.write_bytes(header.encode() + rows.encode() + b"\n")
        return
    kinds = {"float": "f4", "double": "f8", "half": "f2"}
    table = np.stack(list(columns.values()), axis=1).astype((">" if "big" in style else "<") + kinds[kind])
    path.write_bytes(header.encode() + table.tobytes())


def write_compressed_ply(path: Path, scene: Scene) -> None:
    logs = np.log(scene.scales)
    chunks, rows = [], []
    for start in range(0, len(scene.means), 256):
        part = slice(start, start + 256)
        ends = [scene.means[part].min(0), scene.means[part].max(0), logs[part].min(0), logs[part].max(0)]
        chunks.append(np.concatenate(ends))
        rows.append(
            np.stack(
                (
                    _pack_11_10_11(scene.means[part], ends[0], ends[1]),
                    _pack_quaternion(scene.quaternions[part]),
                    _pack_11_10_11(logs[part], ends[2], ends[3]),
                    np.rint(scene.opacities[part] * 255).astype(np.uint32) | np.uint32(0x80808000),
                ),
                axis=1,
            )
        )
    names = [f"{end}_{kind}{axis}" for kind in ("", "scale_") for end in ("min", "max") for axis in "xyz"]
    packed = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
    header = f"ply\nformat binary_little_endian 1.0\nelement chunk {len(chunks)}\n"
    header += "".join(f"property float {name}\n" for name in names) + f"element vertex {len(scene.means)}\n"
    header += "".join(f"property uint {name}\n" for name in packed) + "end_header\n"
    path.write_bytes(header.encode() + np.array(chunks, "<f4").tobytes() + np.concatenate(rows).astype("<u4").tobytes())


def _pack_11_10_11(values: Floats, low: Floats, high: Floats) -> NDArray[np.uint32]:
    share = (values - low) / np.where(high > low, high - low, 1)
    x, y, z = np.rint(share * [2047, 1023, 2047]).astype(np.uint32).T
    return x << np.uint32(21) | y << np.uint32(11) | z


def _smallest_three(quaternions: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Index of the largest component and the three others, the largest made positive."""
    largest = np.abs(quaternions).argmax(axis=1)
    turned = quaternions * np.sign(np.take_along_axis(quaternions, largest[:, None], axis=1))
    kept = np.array([[i for i in range(4) if i != index] for index in range(4)])[largest]
    return largest, np.take_along_axis(turned, kept, axis=1)


def _pack_quaternion(quaternions: Floats) -> NDArray[np.uint32]:
    largest, others = _smallest_three(quaternions)
    a, b, c = np.rint((others / np.sqrt(2) + 0.5) * 1023).astype(np.uint32).T
    return largest.astype(np.uint32) << np.uint32(30) | a << np.uint32(20) | b << np.uint32(10) | c


def write_splat(path: Path, scene: Scene) -> None:
    rows = np.zeros(len(scene.means), dtype=[("m", "<f4", 3), ("s", "<f4", 3), ("c", "u1", 4), ("q", "u1", 4)])
    rows["m"], rows["s"] = scene.means, scene.scales
    rows["c"][:, 3] = np.rint(scene.opacities * 255)
    rows["q"] = np.clip(np.rint(scene.quaternions * 128 + 128), 0, 255)
    path.write_bytes(rows.tobytes())


def spz_streams(scene: Scene, version: int, sh_degree: int = 0, fractional_bits: int = 12) -> tuple[bytes, list[bytes]]:
    """The 16-byte header and the six attribute streams."""
    n_splats = len(scene.means)
    positions = scene.means * RUB
    turned = scene.quaternions * np.array([1, *RUB])
    if version == 1:
        packed = positions.astype("<f2").tobytes()
    else:
        fixed = np.rint(positions * (1 << fractional_bits)).astype("<i4")
        packed = np.ascontiguousarray(fixed[..., None].view("u1")[..., :3]).tobytes()
    if version >= 3:
        largest, others = _smallest_three(turned[:, [1, 2, 3, 0]])
        fields = np.rint(np.abs(others) * 511 * np.sqrt(2)).astype(np.uint32) | (others < 0).astype(np.uint32) << 9
        bits = largest.astype(np.uint32) << 30 | fields[:, 0] << 20 | fields[:, 1] << 10 | fields[:, 2]
        rotations = bits.astype("<u4").tobytes()
    else:
        vector = turned[:, 1:] * np.where(turned[:, :1] < 0, -1, 1)
        rotations = np.clip(np.rint((vector + 1) * 127.5), 0, 255).astype(np.uint8).tobytes()
    scales = np.clip(np.rint((np.log(scene.scales) + 10) * 16), 0, 255).astype(np.uint8).tobytes()
    alphas = np.rint(scene.opacities * 255).astype(np.uint8).tobytes()
    harmonics = bytes(n_splats * (0, 9, 24, 45)[sh_degree])
    header = struct.pack("<4sIIBBBB", b"NGSP", version, n_splats, sh_degree, fractional_bits, 0, 0)
    return header, [packed, alphas, bytes(3 * n_splats), scales, rotations, harmonics]


def write_spz(path: Path, scene: Scene, version: int, sh_degree: int = 1, *, zipped: bool = True) -> None:
    header, streams = spz_streams(scene, version, sh_degree)
    if version == 4:
        path.write_bytes(join_spz_4(header, streams))
        return
    content = header + b"".join(streams)
    path.write_bytes(gzip.compress(content, mtime=0) if zipped else content)


def join_spz_4(header: bytes, streams: list[bytes]) -> bytes:
    import zstandard

    streams = [stream for stream in streams if stream]
    packed = [zstandard.ZstdCompressor().compress(stream) for stream in streams]
    entries = b"".join(struct.pack("<QQ", len(p), len(s)) for p, s in zip(packed, streams, strict=True))
    return header[:15] + struct.pack("<BI12x", len(streams), 32) + entries + b"".join(packed)


def sog_members(scene: Scene) -> dict[str, bytes]:
    """File names and contents of a .sog of version 2."""
    n_splats = len(scene.means)
    logs = np.sign(scene.means) * np.log1p(np.abs(scene.means))
    low, high = logs.min(0), logs.max(0)
    steps = np.rint((logs - low) / np.where(high > low, high - low, 1) * 65535).astype(np.int64)
    codebook = np.linspace(np.log(scene.scales).min(), np.log(scene.scales).max(), 256)
    scales = np.abs(np.log(scene.scales)[..., None] - codebook).argmin(-1)
    largest, others = _smallest_three(scene.quaternions)
    rotations = np.rint((others * np.sqrt(2) + 1) * 127.5)
    opaque = np.full((n_splats, 1), 255)
    images = {
        "means_l.webp": np.concatenate((steps % 256, opaque), axis=1),
        "means_u.webp": np.concatenate((steps // 256, opaque), axis=1),
        "quats.webp": np.concatenate((rotations, largest[:, None] + 252), axis=1),
        "scales.webp": np.concatenate((scales, opaque), axis=1),
        "sh0.webp": np.concatenate((np.zeros((n_splats, 3)), np.rint(scene.opacities * 255)[:, None]), axis=1),
    }
    meta = {
        "version": 2,
        "count": n_splats,
        "means": {"mins": low.tolist(), "maxs": high.tolist(), "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": codebook.tolist(), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": [0.0] * 256, "files": ["sh0.webp"]},
    }
    return {**{name: _webp(pixels) for name, pixels in images.items()}, "meta.json": json.dumps(meta).encode()}


def _webp(pixels: NDArray[np.generic]) -> bytes:
    from PIL import Image

    width = int(np.ceil(np.sqrt(len(pixels))))
    height = -(-len(pixels) // width)
    grid = np.zeros((height * width, 4), dtype=np.uint8)
    grid[: len(pixels)] = pixels
    target = io.BytesIO()
    Image.fromarray(grid.reshape(height, width, 4)).save(target, "WEBP", lossless=True, exact=True)
    return target.getvalue()


def zip_members(members: dict[str, bytes]) -> bytes:
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return target.getvalue()


def write_sog(path: Path, scene: Scene) -> None:
    path.write_bytes(zip_members(sog_members(scene)))


def write_sog_folder(path: Path, scene: Scene) -> None:
    path.mkdir()
    for name, content in sog_members(scene).items():
        (path / name).write_bytes(content)


def write_ksplat(path: Path, scene: Scene, level: int = 0, bucket_size: int = 16, block: float = 10.0) -> None:
    """One section; at levels 1 and 2 full buckets of `bucket_size` and one partial bucket."""
    n_splats = len(scene.means)
    n_full, rest = divmod(n_splats, bucket_size) if level else (0, 0)
    mean, real = ("<f4", "<f4") if level == 0 else ("<u2", "<f2")
    rows = np.zeros(n_splats, dtype=[("m", mean, 3), ("s", real, 3), ("q", real, 4), ("c", "u1", 4)])
    rows["s"], rows["q"] = scene.scales, scene.quaternions
    rows["c"][:, 3] = np.rint(scene.opacities * 255)
    buckets = b""
    if level == 0:
        rows["m"] = scene.means
    else:
        n_buckets = n_full + (rest > 0)
        bucket = np.minimum(np.arange(n_splats) // bucket_size, n_buckets - 1)
        centers = np.stack([scene.means[bucket == i].mean(0) for i in range(n_buckets)])
        rows["m"] = np.rint((scene.means - centers[bucket]) / (block / 2) * 32767) + 32767
        buckets = struct.pack("<I", rest) * (rest > 0) + centers.astype("<f4").tobytes()
    header = bytearray(4096)
    struct.pack_into("<BBHIIIIHH", header, 0, 0, 1, 0, 1, 1, n_splats, n_splats, level, 0)
    section = bytearray(1024)
    n_buckets = n_full + (rest > 0)
    fields = (n_splats, n_splats, bucket_size, n_buckets, block, 12, 32767, 0, n_full, int(rest > 0), 0)
    struct.pack_into("<IIIIfHxxIIIIH", section, 0, *fields)
    path.write_bytes(bytes(header) + bytes(section) + buckets + rows.tobytes())


Writer = Callable[[Path, Scene], None]
WRITERS: dict[str, tuple[str, Writer]] = {
    "3dgs": ("scene.ply", write_ply),
    "3dgs-double": ("scene.ply", lambda path, scene: write_ply(path, scene, kind="double")),
    "3dgs-big-endian": ("scene.ply", lambda path, scene: write_ply(path, scene, style="binary_big_endian")),
    "3dgs-text": ("scene.ply", lambda path, scene: write_ply(path, scene, style="ascii")),
    "compressed": ("scene.compressed.ply", write_compressed_ply),
    "splat": ("scene.splat", write_splat),
    "spz-1": ("scene.spz", lambda path, scene: write_spz(path, scene, 1)),
    "spz-2": ("scene.spz", lambda path, scene: write_spz(path, scene, 2)),
    "spz-2-plain": ("scene.spz", lambda path, scene: write_spz(path, scene, 2, zipped=False)),
    "spz-3": ("scene.spz", lambda path, scene: write_spz(path, scene, 3)),
    "spz-4": ("scene.spz", lambda path, scene: write_spz(path, scene, 4)),
    "sog": ("scene.sog", write_sog),
    "sog-folder": ("scene", write_sog_folder),
    "ksplat-0": ("scene.ksplat", write_ksplat),
    "ksplat-1": ("scene.ksplat", lambda path, scene: write_ksplat(path, scene, 1)),
    "ksplat-2": ("scene.ksplat", lambda path, scene: write_ksplat(path, scene, 2)),
}
