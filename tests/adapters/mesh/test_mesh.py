"""from_mesh: sources, merging, formats, sampling, gradients, and refusals."""

from __future__ import annotations

import gc
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from torch.autograd import gradcheck

import topokit as tk
from topokit.core.mesh.sampling import sample_triangles
from topokit.errors import GenusError, InputError, ReadError
from topokit.testing import genus_mesh, icosphere, torus_mesh

FORMATS = ["obj", "off", "ply", "stl", "glb", "3mf"]


@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_gives_the_same_certain_answer(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"shape.{suffix}"
    trimesh.Trimesh(*genus_mesh(2), process=False).export(path)
    shape = tk.load(path)
    report = shape.report()
    assert (report.euler, report.genus, report.verdict, report.closed) == (-2, 2, "certain", True)
    assert (report.surface_betti, report.solid_betti) == ((1, 4, 1), (1, 2, 0))
    assert float(shape.gauss_bonnet()) == pytest.approx(-2, abs=0.5)


def test_content_is_believed_before_the_suffix(tmp_path: Path) -> None:
    path = tmp_path / "really_a.stl"
    trimesh.Trimesh(*torus_mesh(), process=False).export(path, file_type="ply")
    assert tk.load(path).report().euler == 0


def test_arrays_tensors_and_trimesh_objects_agree() -> None:
    vertices, faces = torus_mesh()
    sources = (
        (vertices, faces),
        [vertices, faces],
        (vertices.tolist(), faces.tolist()),
        (torch.from_numpy(vertices), torch.from_numpy(faces)),
        trimesh.Trimesh(vertices, faces, process=False),
    )
    shapes = [tk.from_mesh(source) for source in sources]
    shapes.append(tk.from_mesh(vertices, faces))
    shapes.append(tk.from_mesh(torch.from_numpy(vertices), faces=faces.tolist()))
    assert {(shape.report().euler, shape.report().verdict) for shape in shapes} == {(0, "certain")}
    assert len({float(shape.gauss_bonnet()) for shape in shapes}) == 1


def test_an_unwelded_mesh_is_merged_and_says_so() -> None:
    vertices, faces = torus_mesh(20, 10)
    shape = tk.from_mesh((vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)))
    report = shape.report()
    assert (report.euler, report.verdict) == (0, "certain")
    assert "1000 vertices merged with an equal one, which closes the mesh." in report.reasons


def test_a_closed_mesh_is_left_alone_though_vertices_coincide() -> None:
    vertices, faces = icosphere(2)
    twice = np.concatenate((vertices, vertices)), np.concatenate((faces, faces + len(vertices)))
    report = tk.from_mesh(twice).report()
    assert (report.euler, report.components, report.verdict) == (4, 2, "certain")


def test_a_rounded_seam_is_closed_but_only_likely() -> None:
    vertices, faces = torus_mesh(20, 10)
    noise = np.random.default_rng(0).uniform(-1e-9, 1e-9, (faces.size, 3))
    report = tk.from_mesh((vertices[faces].reshape(-1, 3) + noise, np.arange(faces.size).reshape(-1, 3))).report()
    assert (report.euler, report.closed, report.verdict) == (0, True, "likely")


def mobius_strip(count: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a band with half a twist."""
    angle = np.arange(count) * 2 * np.pi / count
    across = np.stack((np.cos(angle / 2) * np.cos(angle), np.cos(angle / 2) * np.sin(angle), np.sin(angle / 2)), axis=1)
    middle = np.stack((np.cos(angle), np.sin(angle), 0 * angle), axis=1)
    first, second = np.arange(count), np.arange(count) + count
    after, beyond = np.roll(first, -1), np.roll(second, -1)
    after[-1], beyond[-1] = second[0], first[0]
    faces = np.concatenate((np.stack((first, after, second), 1), np.stack((after, beyond, second), 1)))
    return np.concatenate((middle - 0.3 * across, middle + 0.3 * across)), faces


def test_the_integer_of_an_open_manifold_is_certain() -> None:
    vertices, faces = torus_mesh(20, 10)
    shape = tk.from_mesh((vertices, faces[1:]))
    report = shape.report()
    assert (report.euler, report.genus, report.boundary_loops) == (-1, 1, 1)
    assert (report.verdict, report.closed, report.n_deciding) == ("certain", False, 1)
    assert "one or two faces" in report.reasons[0]
    width = np.ptp(vertices[faces[0]], axis=0).max()
    assert shape.genus() == shape.genus(cap=1.01 * width) == 1
    with pytest.raises(GenusError, match=f"{width:.4g} wide"):
        shape.genus(cap=0.99 * width)
    for wrong in (0.0, np.nan):
        with pytest.raises(InputError, match="positive width"):
            shape.genus(cap=wrong)


def test_a_mobius_strip_is_certain_and_has_no_genus() -> None:
    shape = tk.from_mesh(mobius_strip())
    report = shape.report()
    assert (report.euler, report.genus, report.boundary_loops, report.verdict) == (0, None, 1, "certain")
    with pytest.raises(GenusError, match=r"one-sided .* shape\.report\(\)\.euler is 0"):
        shape.genus()


def test_what_is_no_manifold_is_unsure_and_its_genus_names_the_next_call() -> None:
    shape = tk.from_mesh(np.eye(3, 5).T + np.arange(5)[:, None], [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    assert shape.report().verdict == "unsure"
    with pytest.raises(GenusError, match=r"shape\.defects\(\), or topokit report --locate"):
        shape.genus()


@pytest.mark.parametrize("apart", [0.0, 1e-10])
def test_an_open_mesh_whose_boundary_touches_other_vertices_is_unsure(apart: float) -> None:
    vertices, faces = icosphere(2)
    corners = vertices[faces[:40]].reshape(-1, 3)
    tripled = np.concatenate((vertices, corners * (1 + apart)))  # a patch of the closed sphere written a second time
    report = tk.from_mesh((tripled, np.concatenate((faces, len(vertices) + np.arange(120).reshape(-1, 3))))).report()
    assert (report.closed, report.verdict) == (False, "unsure")
    alone = tk.from_mesh((corners, np.arange(120).reshape(-1, 3))).report()  # merged, it touches nothing
    assert (alone.closed, alone.verdict) == (False, "certain")


def test_faults_are_plain_sentences() -> None:
    vertices, faces = icosphere(2)
    extra = np.concatenate((vertices, [[9.0, 9, 9]]))
    broken = np.concatenate((faces[1:], [[5, 5, 6]]))
    broken[7] = broken[7, ::-1]
    report = tk.from_mesh((extra, broken)).report()
    assert (report.euler, report.verdict, report.closed, report.boundary_loops) == (1, "certain", False, 1)
    text = "\n".join(report.reasons)
    for sentence in (
        "Not counted: 1 vertex without a face.",
        "Not counted: 1 face with a repeated vertex.",
        "It is open: 3 edges in 1 boundary loop have only one face.",
        "1 face turned against the others",
    ):
        assert sentence in text


def test_euler_is_differentiable_in_the_vertices() -> None:
    vertices, faces = torus_mesh(40, 20)
    moving = torch.from_numpy(vertices).requires_grad_()
    shape = tk.from_mesh((moving, faces))
    shape.gauss_bonnet().backward()
    assert moving.grad is not None
    assert moving.grad.isfinite().all()
    assert float(moving.grad.abs().max()) > 0


def test_sampling_passes_gradcheck() -> None:
    vertices, faces = icosphere(1)

    def draw(values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        samples, _ = sample_triangles(values, torch.from_numpy(faces), 30, torch.Generator().manual_seed(5))
        assert samples.normals is not None
        return samples.points, samples.normals

    _, fixed = sample_triangles(torch.from_numpy(vertices), torch.from_numpy(faces), 30)
    assert len(fixed.unique()) > 15

    def at_fixed_faces(values: torch.Tensor) -> torch.Tensor:
        # A step of 1e-6 moves the area shares; the draws stay in their faces for this seed, which gradcheck confirms.
        return torch.cat(draw(values))

    assert gradcheck(at_fixed_faces, (torch.from_numpy(vertices).requires_grad_(),))


def test_samples_are_spread_by_area_and_lie_on_the_mesh(generator: torch.Generator) -> None:
    vertices, faces = (torch.from_numpy(part) for part in torus_mesh(12, 6))
    samples, face = sample_triangles(vertices, faces, 60_000, generator)
    corners = vertices[faces]
    areas = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], dim=-1).norm(dim=-1) / 2
    counts = torch.bincount(face, minlength=len(faces)).double()
    torch.testing.assert_close(counts / 60_000, areas / areas.sum(), rtol=0, atol=2 / 60_000)
    height = ((samples.points - corners[face, 0]) * samples.normals).sum(-1)
    assert float(height.abs().max()) < 1e-12
    inside = samples.points - corners[face].mean(1)  # uniform in each triangle: the mean is the centroid
    assert float(inside.mean(0).abs().max()) < 2e-3


def test_the_same_seed_gives_the_same_answer() -> None:
    mesh = genus_mesh(1)
    one, two = (tk.from_mesh(mesh, generator=torch.Generator().manual_seed(3)) for _ in range(2))
    assert torch.equal(one.samples.points, two.samples.points)
    assert torch.equal(one.gauss_bonnet(), two.gauss_bonnet())
    other = tk.from_mesh(mesh, generator=torch.Generator().manual_seed(4))
    assert not torch.equal(one.samples.points, other.samples.points)


def test_samples_are_drawn_when_they_are_first_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[int] = []

    def draw(*arguments: object) -> object:
        drawn.append(1)
        return sample_triangles(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr("topokit.adapters.mesh.adapter.sample_triangles", draw)
    shape = tk.from_mesh(torus_mesh(20, 10))
    assert not drawn
    assert torch.equal(shape.samples.points, shape.samples.points)
    assert len(drawn) == 1


def test_draws_do_not_depend_on_when_they_are_made() -> None:
    vertices, faces = genus_mesh(1)
    generator = torch.Generator().manual_seed(3)
    early = tk.from_mesh(vertices, faces, generator=generator)
    later = tk.from_mesh(vertices, faces, generator=generator)
    same = tk.from_mesh(vertices, faces, generator=torch.Generator().manual_seed(3))
    torch.rand(100, generator=generator)
    assert torch.equal(early.samples.points, same.samples.points)
    assert not torch.equal(early.samples.points, later.samples.points)
    default = tk.from_mesh(vertices, faces)
    first, _ = sample_triangles(*default.mesh, 10_000, torch.Generator().manual_seed(0))  # type: ignore[misc]
    assert torch.equal(default.samples.points, first.points)


def test_faces_may_be_whole_numbers_of_a_floating_type() -> None:
    vertices, faces = torus_mesh(10, 6)
    assert tk.from_mesh(vertices, np.asarray(faces, dtype=np.float32)).report().euler == 0
    assert tk.from_mesh(vertices, torch.as_tensor(faces).double()).report().euler == 0


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (([[0.0, 0, 0], [1, 0, 0]], [[0, 1, 2]]), "face index 2 is out of range: there are 2 vertices"),
        (([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, -1]]), "face index -1 is out of range"),
        (([[0.0, 0], [1, 0]], [[0, 1, 2]]), r"vertices must have shape \(V, 3\), got \(2, 2\)"),
        (([[0.0, 0, 0]] * 4, [[0, 1], [2, 3]]), r"faces must have shape \(F, 3\), .* or a list of lists; got \(2, 2\)"),
        (([[0.0, 0, 0]] * 4, [[0, 1, 2, 3], [0, 1]]), "face 1 has 2 corners; at least 3 are needed"),
        (([[0.0, 0, 0]] * 4, [[0, 1, 2, 3], [0, 1, -1, -1]]), "face 1 has 2 corners; at least 3 are needed"),
        (([[0.0, 0, 0]] * 4, [[0, 1, 2, 3], [0, -1, 1, 2]]), "a face has −1 between its corners"),
        (([[0.0, 0, 0]] * 4, [[0, 1, 2, 3], [0, 1, 2, -2]]), "face index -2 is out of range"),
        (([[0.0, 0, 0]] * 4, [[0, 1, 2, 3], [0, 1, 2.5]]), "faces must be whole numbers, got float64"),
        (([[0.0, 0, 0]] * 4, [[0, 1, 2, 3], 7]), "faces could not be read as lists of vertex indices"),
        (([[0.0, 0, 0]] * 3, [[0.0, 1.0, np.nan]]), "faces must be whole numbers, got float64"),
        (([[0.0, 0, 0]] * 3, [[1, 2, 3]]), "face index 3 is out of range: .*subtract 1"),
        ((np.zeros((3, 8)), [[0, 1, 2]]), r"got \(3, 8\)\. Transpose"),
        (([[0.0, 0, 0]] * 3, np.zeros((0, 3), int)), "the mesh has no faces"),
        (([[0.0, 0, 0]] * 3, [[0, 1, 2]]), "the mesh has no area"),
        (([[0.0, 0, 0]] * 3, [[0, 1, 1]]), "every face of the mesh names a vertex twice"),
        (([[0.0, 0, 0], [1, 0, 0], [np.nan, 1, 0]], [[0, 1, 2]]), "1 face with vertices that are NaN or infinite"),
        (([["a", 0, 0]], [[0, 0, 0]]), "vertices could not be read as numbers"),
        ((torch.zeros(3, 3, dtype=torch.int64), [[0, 1, 2]]), "vertices must be floating point, got torch.int64"),
        (
            42,
            "from_mesh got int; expected a path, vertices and faces, a mesh of trimesh or open3d, or anything",
        ),
    ],
)
def test_bad_input_is_explained(source: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        tk.from_mesh(source)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("empty.off", b"", "is empty"),
        ("cut.off", b"OFF\n4 4 6\n0 0 0\n1 0 0\n", "announces 4 vertices and 4 faces but has only"),
        ("short.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "a face announces 3 corners and has 2"),
        ("huge.off", b"OFF\n999999999999 9 0\n0 0 0\n", "announces 999999999999 vertices"),
        (
            "cut.ply",
            b"ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nelement face 3\nend_header\n",
            "announces 9 rows of element 'vertex'",
        ),
        (
            "cut.stl",
            b"\0" * 80 + b"\xff\xff\xff\x7f" + b"\0" * 50,
            "announces 2147483647 triangles and has bytes for 1",
        ),
        ("range.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "could not be read"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "holds no triangles"),
        ("broken.glb", b"glTF\x02\0\0\0\xff\xff\xff\xff", "could not be read"),
        ("broken.3mf", b"PK\x03\x04 3D/ nothing of the kind", "could not be read"),
    ],
)
def test_broken_files_are_read_errors(name: str, content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ReadError, match=message):
        tk.from_mesh(path)


def test_polygons_in_off_files_are_cut_into_fans(tmp_path: Path) -> None:
    path = tmp_path / "prism.off"
    angle = np.arange(6) * np.pi / 3
    corners = [f"{np.cos(a):.9f} {np.sin(a):.9f} {z}" for z in (0, 1) for a in angle]
    sides = [f"4 {i} {(i + 1) % 6} {(i + 1) % 6 + 6} {i + 6}" for i in range(6)]
    caps = ["6 5 4 3 2 1 0", "6 6 7 8 9 10 11"]
    path.write_text("OFF # a hexagonal prism\n12 8 18\n" + "\n".join(corners + sides + caps))
    report = tk.load(path).report()
    assert (report.euler, report.verdict) == (2, "certain")


def test_obj_words_apart_by_tabs_and_lines_with_blanks_before_them(tmp_path: Path) -> None:
    path = tmp_path / "indented.obj"
    path.write_bytes(
        b"# made by hand\r\n  v\t0 0 0\r\n\tv 1 0 0\r\nv 0 1 0\nv 0 0 1 # the top\n"
        b"g one/two\nf 1/1 3/1 \\\r\n2/1\n f 1 2 4\nf\t1//7 4//7 3//7\nf 2 3 4\n"
    )
    report = tk.load(path).report()
    assert (report.euler, report.verdict) == (2, "certain")


def test_instances_of_a_scene_are_put_in_place(tmp_path: Path) -> None:
    path = tmp_path / "scene.glb"
    scene = trimesh.Scene(trimesh.Trimesh(*icosphere(1), process=False))
    scene.export(path)
    assert tk.load(path).report().per_component[0].bounds[1] == pytest.approx((1, 1, 1))
    scene.apply_translation((5.0, 0, 0))
    scene.export(path)
    assert tk.load(path).report().per_component[0].bounds[1] == pytest.approx((6, 1, 1))
    scene.add_geometry(trimesh.Trimesh(*torus_mesh(12, 8), process=False))
    scene.export(path)
    assert (tk.load(path).report().euler, tk.load(path).report().components) == (2, 2)


def test_obj_seams_and_materials_do_not_split_the_mesh(tmp_path: Path) -> None:
    vertices, faces = torus_mesh(12, 8)
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + ["vt 0 0", "vt 1 1", "vn 0 0 1"]
    for index, (a, b, c) in enumerate(faces + 1):
        lines += [f"usemtl m{index % 5}", f"f {a}/1/1 {b}/{index % 2 + 1}/1 \\", f" {c}/2/1"]
    path = tmp_path / "seams.obj"
    path.write_text("mtllib nowhere.mtl\n" + "\n".join(lines))
    shape = tk.load(path)
    assert shape.report().reasons[0].startswith("Every edge has two faces")
    assert shape.report().euler == 0


def test_nothing_is_left_behind_by_a_report() -> None:
    shape = tk.from_mesh(torus_mesh(20, 10), n_samples=500)
    shape.report()
    gc.collect()
    assert not any(torch.is_tensor(o) and o.grad_fn is not None for o in (shape.samples.points, shape.samples.normals))


def test_overlapping_parts_are_said_with_the_solid_they_make() -> None:
    vertices, faces = icosphere(3)
    double = (
        np.concatenate((vertices, vertices + np.array([1.0, 0, 0]))),
        np.concatenate((faces, faces + len(vertices))),
    )
    report = tk.from_mesh(double).report(details=True)
    assert (report.euler, report.verdict) == (4, "certain")
    assert any("intersects or overlaps itself" in reason and "χ = 2;" in reason for reason in report.reasons)
    solid = next(one for one in report.evidence if one.name == "solid by winding number")
    assert solid.integer == 2


def test_parts_that_barely_overlap_are_said_though_little_area_is_inside() -> None:
    vertices, faces = icosphere(3)
    beside = vertices + np.array([1.9, 0, 0])
    pair = np.concatenate((vertices, beside)), np.concatenate((faces, faces + len(vertices)))
    report = tk.from_mesh(pair).report(details=True)
    assert report.euler == 4
    assert any("χ = 2: parts of the mesh overlap" in reason for reason in report.reasons)


def test_soups_and_punctured_meshes_have_the_solid_as_second_evidence() -> None:
    vertices, faces = torus_mesh(40, 20)
    report = tk.from_mesh((vertices, faces[7:])).report(details=True)
    assert not report.closed
    assert any("encloses by winding number" in reason and "χ = 0." in reason for reason in report.reasons)
    clean = tk.from_mesh((vertices, faces)).report(details=True)
    assert not any("winding number" in reason for reason in clean.reasons)
