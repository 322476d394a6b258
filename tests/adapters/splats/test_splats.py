"""Gaussian splats as shapes: what is dropped, where the samples lie, and what is differentiable."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from splat_writers import Scene, torus_scene, write_ply, write_sog_folder, write_splat
from torch import Tensor

import topokit as tk
from topokit.adapters.splats.disc_samples import sample_discs
from topokit.adapters.splats.normals import rotation_matrices
from topokit.errors import InputError
from topokit.testing import icosphere


def splats_of(scene: Scene) -> tk.GaussianSplats:
    return tk.GaussianSplats(*(torch.from_numpy(np.ascontiguousarray(part)) for part in scene))


def joined(*scenes: Scene) -> Scene:
    return Scene(*(np.concatenate(parts) for parts in zip(*scenes, strict=True)))


def moved(scene: Scene, offset: float) -> Scene:
    return scene._replace(means=scene.means + np.array([offset, 0, 0]))


def torus_distance(points: Tensor, major: float = 1.0, minor: float = 0.4) -> Tensor:
    return torch.hypot(points[:, :2].norm(dim=-1) - major, points[:, 2]) - minor


def note(shape: tk.Shape, text: str) -> str:
    found = [sentence for sentence in shape.notes if text in sentence]
    assert len(found) == 1, shape.notes
    return found[0]


# Samples


def test_samples_lie_on_the_surface_and_cover_it() -> None:
    scene = torus_scene(4000)
    shape = tk.from_splats(splats_of(scene), n_samples=20_000)
    points = shape.samples.points
    spacing = np.median(scene.scales[:, 0]) / 0.75
    assert float(torus_distance(points).abs().max()) < 0.7 * spacing**2 / 0.4 + 0.2 * spacing
    everywhere = torch.from_numpy(torus_scene(3000, seed=5).means)
    gaps = torch.cdist(everywhere, points).amin(-1)
    at_centers = torch.cdist(everywhere, torch.from_numpy(scene.means)).amin(-1)
    assert float(gaps.quantile(0.99)) < 0.8 * float(at_centers.quantile(0.99))


def test_normals_are_the_axes_of_the_smallest_scales_whichever_column_that_is() -> None:
    scene = torus_scene(1000)
    for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0)):
        rotated = rotation_matrices(torch.from_numpy(scene.quaternions))[:, :, list(order)]
        from scipy.spatial.transform import Rotation

        quaternions = Rotation.from_matrix(rotated.numpy()).as_quat()[:, [3, 0, 1, 2]]
        turned = scene._replace(quaternions=quaternions, scales=scene.scales[:, list(order)])
        samples = tk.from_splats(splats_of(turned), n_samples=2000).samples
        frames = samples.frames
        assert frames is not None
        assert not samples.oriented
        identity = torch.eye(3, dtype=torch.float64).expand(2000, 3, 3)
        torch.testing.assert_close(frames @ frames.mT, identity, rtol=0, atol=1e-12)
        torch.testing.assert_close(torch.linalg.det(frames), torch.ones(2000).double(), rtol=0, atol=1e-12)
        points = samples.points
        ring = points * torch.tensor([1.0, 1.0, 0.0])
        outward = torch.nn.functional.normalize(points - ring / ring.norm(dim=-1, keepdim=True), dim=-1)
        assert float((frames[:, 2] * outward).sum(-1).abs().quantile(0.01)) > 0.95


def test_rotation_matrices_agree_with_scipy() -> None:
    from scipy.spatial.transform import Rotation

    quaternions = torch.nn.functional.normalize(torch.randn(50, 4, generator=torch.Generator().manual_seed(0)).double())
    expected = Rotation.from_quat(quaternions[:, [1, 2, 3, 0]].numpy()).as_matrix()
    np.testing.assert_allclose(rotation_matrices(quaternions).numpy(), expected, atol=1e-12)


def test_samples_are_shared_out_by_area_and_opacity() -> None:
    means = torch.tensor([[0.0, 0, 0], [10, 0, 0], [20, 0, 0]], dtype=torch.float64)
    scales = torch.tensor([[1.0, 1, 0.01], [2, 1, 0.01], [1, 1, 0.01]], dtype=torch.float64)
    quaternions = torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64).expand(3, 4)
    splats = tk.GaussianSplats(means, scales, quaternions, torch.tensor([1.0, 1.0, 0.5], dtype=torch.float64))
    counts = torch.bincount(sample_discs(splats, 7000).splat).tolist()
    assert counts == pytest.approx([2000, 4000, 1000], abs=1)


def test_samples_do_not_depend_on_when_they_are_made() -> None:
    generator = torch.Generator().manual_seed(5)
    first, second = (tk.from_splats(splats_of(torus_scene(500)), generator=generator) for _ in range(2))
    late = second.samples.points, first.samples.points
    again = torch.Generator().manual_seed(5)
    early = [tk.from_splats(splats_of(torus_scene(500)), generator=again).samples.points for _ in range(2)]
    assert torch.equal(late[1], early[0])
    assert torch.equal(late[0], early[1])
    assert not torch.equal(early[0], early[1])


def test_the_generator_decides_the_samples() -> None:
    splats = splats_of(torus_scene(500))
    seeded = [
        tk.from_splats(splats, generator=torch.Generator().manual_seed(seed)).samples.points for seed in (1, 1, 2)
    ]
    assert torch.equal(seeded[0], seeded[1])
    assert not torch.equal(seeded[0], seeded[2])
    assert torch.equal(tk.from_splats(splats).samples.points, tk.from_splats(splats).samples.points)


def test_every_splat_has_one_sample_unless_a_number_is_given() -> None:
    scene = torus_scene(900)
    splats = splats_of(scene)
    points = tk.from_splats(splats).samples.points
    assert float((points - splats.means).norm(dim=1).max()) <= 0.25 * scene.scales.max()
    assert tk.from_splats(splats, n_samples=333).samples.n_points == 333


@pytest.mark.parametrize("n_splats", [400, 1500])
def test_small_closed_scenes_are_likely(n_splats: int) -> None:
    report = tk.from_splats(splats_of(torus_scene(n_splats))).report()
    assert (report.verdict, report.genus, report.closed) == ("likely", 1, True)


def test_a_torus_of_splats_has_an_estimate_near_zero() -> None:
    assert abs(float(tk.from_splats(splats_of(torus_scene(6000))).gauss_bonnet())) < 1


def test_moving_and_scaling_the_scene_moves_and_scales_the_samples() -> None:
    scene = torus_scene(800)
    before = tk.from_splats(splats_of(scene), n_samples=900).samples.points
    after = tk.from_splats(
        splats_of(scene._replace(means=3 * scene.means + 5, scales=3 * scene.scales)), n_samples=900
    ).samples.points
    torch.testing.assert_close(after, 3 * before + 5, rtol=0, atol=1e-9)


# Gradients


def test_points_and_frames_are_differentiable_in_means_scales_and_quaternions() -> None:
    scene = torus_scene(12)
    leaves = [torch.from_numpy(np.ascontiguousarray(part)).requires_grad_() for part in scene[:3]]
    opacities = torch.from_numpy(scene.opacities)

    def sampled(means: Tensor, scales: Tensor, quaternions: Tensor) -> tuple[Tensor, Tensor]:
        splats = tk.GaussianSplats(means, scales, quaternions, opacities)
        samples = tk.from_splats(splats, component="all", min_cluster_share=None, n_samples=24, n_neighbors=5).samples
        assert samples.frames is not None
        return samples.points, samples.frames

    assert torch.autograd.gradcheck(sampled, leaves, eps=1e-7, atol=1e-5)


def test_the_estimate_has_finite_gradients_everywhere() -> None:
    scene = torus_scene(1500)
    raw = {
        "means": torch.from_numpy(scene.means).requires_grad_(),
        "scales": torch.from_numpy(np.log(scene.scales)).requires_grad_(),
        "quats": torch.from_numpy(scene.quaternions * 2).requires_grad_(),
        "opacities": torch.from_numpy(np.log(scene.opacities / (1.0001 - scene.opacities))).requires_grad_(),
    }
    tk.from_splats(raw).gauss_bonnet().backward()
    for name in ("means", "scales", "quats"):
        gradient = raw[name].grad
        assert gradient is not None
        assert bool(torch.isfinite(gradient).all())
        assert float(gradient.abs().max()) > 0, name


# Cleaning


def test_a_clean_scene_loses_nothing() -> None:
    shape = tk.from_splats(splats_of(torus_scene(3000)))
    assert shape.notes == ("3000 samples lie on the discs of 3000 of 3000 splats.",)


def test_everything_dropped_is_counted() -> None:
    scene = torus_scene(3000)
    rng = np.random.default_rng(0)
    scene.opacities[:100] = 0.02
    scene.scales[100:140, :2] *= 40
    scene.scales[140:340, 2] = scene.scales[140:340, 0]
    scene.means[340:350] = np.nan
    scene.quaternions[350:355] = 0
    floaters = torus_scene(6)._replace(means=rng.uniform(30, 60, size=(6, 3)))
    floaters.scales[:] = [0.02, 0.02, 0.001]
    shape = tk.from_splats(splats_of(joined(scene, floaters)))
    assert note(shape, "NaN").startswith("15 of 3006 splats")
    assert note(shape, "min_opacity=0.1").startswith("100 of 2991 splats")
    assert note(shape, "max_size_ratio=10").startswith("40 of 2891 splats")
    assert note(shape, "max_thickness_ratio=0.5").startswith("200 of 2845 splats")
    assert note(shape, "min_cluster_share=0.01").startswith("6 of 2851 splats lie in isolated clusters (6)")
    assert note(shape, "samples lie on").endswith("of 2645 of 3006 splats.")
    assert set(shape.notes) <= set(shape.report().reasons)


@pytest.mark.parametrize("switch", ["min_opacity", "max_size_ratio", "max_thickness_ratio", "min_cluster_share"])
def test_every_filter_has_a_switch(switch: str) -> None:
    scene = torus_scene(1000)
    scene.opacities[:10] = 0.02
    scene.scales[10:20, :2] *= 15
    scene.scales[20:30, 2] = scene.scales[20:30, 0]
    far = moved(torus_scene(2), 50.0)._replace(scales=np.tile(scene.scales[50], (2, 1)))
    splats = splats_of(joined(scene, far))
    dropped = [switch in sentence for sentence in tk.from_splats(splats, component="all").notes]
    kept = [switch in sentence for sentence in tk.from_splats(splats, component="all", **{switch: None}).notes]
    assert sum(dropped) == 1
    assert not any(kept)


def test_components_are_chosen_by_area() -> None:
    large, small = torus_scene(2000), moved(torus_scene(1500, 0.6, 0.2), 8.0)
    splats = splats_of(joined(small, large))
    largest = tk.from_splats(splats, component="largest", n_samples=500)
    assert float(largest.samples.points[:, 0].max()) < 2
    assert "1500 of 3500 splats lie in other clusters (2 in all" in note(largest, "component='largest'")
    assert torch.equal(largest.samples.points, tk.from_splats(splats, component=0, n_samples=500).samples.points)
    assert float(tk.from_splats(splats, component=1, n_samples=500).samples.points[:, 0].min()) > 6
    everything = tk.from_splats(splats, n_samples=500).samples.points[:, 0]
    assert float(everything.min()) < 2
    assert float(everything.max()) > 6
    for component in (2, -1, "biggest", True):
        with pytest.raises(InputError, match="2 clusters"):
            tk.from_splats(splats, component=component)  # type: ignore[arg-type]


def test_parts_that_nearly_touch_are_one_cluster_and_a_large_disc_belongs_to_its_rim() -> None:
    scene = torus_scene(3000)
    gap = 2.8 + 0.5 * float(np.median(scene.scales[:, 0]))
    assert len(tk.from_splats(splats_of(joined(scene, moved(scene, gap)))).notes) == 1
    lid = Scene(np.zeros((1, 3)), np.array([[0.42, 0.42, 0.001]]), np.array([[1.0, 0, 0, 0]]), np.ones(1))
    shape = tk.from_splats(splats_of(joined(scene, lid)), max_size_ratio=None, n_samples=5000)
    assert float(shape.samples.points[:, :2].norm(dim=-1).min()) < 0.2


@pytest.mark.parametrize("distance", [1e3, 1e9, 1e30])
def test_a_splat_far_away_does_not_coarsen_the_clusters(distance: float) -> None:
    both = joined(torus_scene(1500), moved(torus_scene(1000, 0.6, 0.2), 8.0))
    far = moved(torus_scene(1), distance)._replace(scales=both.scales[:1])
    shape = tk.from_splats(splats_of(joined(both, far)), component="largest")
    assert "(2 in all" in note(shape, "component=")
    assert note(shape, "min_cluster_share").startswith("1 of 2501 splats")


def test_blobs_are_kept_and_their_normals_put_aside() -> None:
    scene = torus_scene(2000)
    scene.scales[:] = scene.scales[:, :1]
    shape = tk.from_splats(splats_of(scene))
    assert shape.samples.frames is None
    assert shape.samples.normals is None
    assert "2000 of 2000 splats" in note(shape, "most are blobs")
    assert tk.from_splats(splats_of(scene), max_thickness_ratio=None).samples.frames is not None


def test_an_empty_result_names_the_filter() -> None:
    scene = torus_scene(100)
    splats = splats_of(scene._replace(opacities=np.full(100, 0.01)))
    with pytest.raises(InputError, match=r"min_opacity=0\.1.*pass None"):
        tk.from_splats(splats)
    with pytest.raises(InputError, match="opacity 0"):
        tk.from_splats(splats_of(scene._replace(opacities=np.zeros(100))), min_opacity=None)
    scene.means[:60] = np.inf
    with pytest.raises(InputError, match="60 of 100"):
        tk.from_splats(splats_of(scene))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"min_opacity": 2.0}, "min_opacity"),
        ({"max_thickness_ratio": -0.1}, "max_thickness_ratio"),
        ({"min_cluster_share": float("nan")}, "min_cluster_share"),
        ({"max_size_ratio": 0.5}, "max_size_ratio"),
        ({"n_samples": 20}, "n_samples"),
    ],
)
def test_limits_out_of_range_are_refused(options: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        tk.from_splats(splats_of(torus_scene(100)), **options)  # type: ignore[arg-type]


# GaussianSplats and dictionaries


def test_quaternions_become_unit_and_the_gradient_reaches_what_was_given() -> None:
    scene = torus_scene(5)
    given = (torch.from_numpy(scene.quaternions) * 3).requires_grad_()
    splats = tk.GaussianSplats(*(torch.from_numpy(part) for part in scene[:2]), given, torch.ones(5).double())
    torch.testing.assert_close(splats.quaternions, torch.from_numpy(scene.quaternions), rtol=0, atol=1e-12)
    assert splats.quaternions.requires_grad
    extreme = tk.GaussianSplats(
        torch.zeros(2, 3), torch.ones(2, 3), torch.tensor([[1e-30, 0, 0, 0], [0, 0, 0, 1e30]]), torch.ones(2)
    )
    torch.testing.assert_close(extreme.quaternions, torch.tensor([[1.0, 0, 0, 0], [0, 0, 0, 1]]))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"scales": -torch.ones(4, 3)}, "exp"),
        ({"opacities": torch.tensor([0.5, 3.0, 0.1, 0.2])}, "sigmoid"),
        ({"scales": torch.ones(4, 2)}, r"\(4, 3\)"),
        ({"quaternions": torch.ones(4, 3)}, r"\(4, 4\)"),
        ({"opacities": torch.ones(4, 1)}, r"\(4,\)"),
        ({"means": torch.zeros(4, 3).double()}, "float64"),
        ({"means": torch.zeros(4, 3).long()}, "floating-point"),
        ({"means": np.zeros((4, 3))}, "floating-point"),
    ],
)
def test_wrong_tensors_are_refused_with_what_to_do(changed: dict[str, object], words: str) -> None:
    parts: dict[str, object] = {
        **{"means": torch.zeros(4, 3), "scales": torch.ones(4, 3)},
        **{"quaternions": torch.ones(4, 4), "opacities": torch.ones(4)},
    }
    with pytest.raises(InputError, match=words):
        tk.GaussianSplats(**{**parts, **changed})  # type: ignore[arg-type]


def linear_dictionary(scene: Scene) -> dict[str, Tensor]:
    """What is passed to `gsplat.rasterization`."""
    return dict(zip(("means", "scales", "quats", "opacities"), map(torch.from_numpy, scene), strict=True))


def stored_dictionary(scene: Scene) -> dict[str, Tensor]:
    """What gsplat's trainer stores."""
    linear = linear_dictionary(scene)
    opacities = linear["opacities"].clamp(max=0.999).logit()[:, None]
    return {**linear, "scales": linear["scales"].log(), "opacities": opacities}


def test_a_trainer_s_dictionary_and_the_rasterizer_s_arguments() -> None:
    scene = torus_scene(400)
    linear, stored = linear_dictionary(scene), stored_dictionary(scene)
    expected = splats_of(scene)
    for splats in (
        tk.GaussianSplats.from_dict(linear, activated=True),
        tk.GaussianSplats.from_dict(stored),
        tk.GaussianSplats.from_dict({"step": 7, "splats": torch.nn.ParameterDict(stored)}),
    ):
        torch.testing.assert_close(splats.scales, expected.scales, rtol=1e-12, atol=0)
        torch.testing.assert_close(splats.opacities, expected.opacities, rtol=0, atol=1e-3)
    assert tk.from_splats(torch.nn.ParameterDict(stored), n_samples=50).samples.points.requires_grad
    with pytest.raises(InputError, match=r"pass activated=True if they are linear already"):
        tk.from_splats(linear)
    given = tk.from_splats(linear, activated=True, n_samples=50).samples.points
    assert torch.equal(given, tk.from_splats(expected, n_samples=50).samples.points)
    with pytest.raises(
        InputError, match=r"activated=True is for dictionaries of tensors.*GaussianSplats: leave it out"
    ):
        tk.from_splats(expected, activated=True)
    with pytest.raises(InputError, match="lacks quats"):
        tk.GaussianSplats.from_dict({key: value for key, value in linear.items() if key != "quats"})


NAMES = {
    "gsplat": ("means", "scales", "quats", "opacities"),
    "INRIA": ("_xyz", "_scaling", "_rotation", "_opacity"),
    "INRIA, without underscores": ("xyz", "scaling", "rotation", "opacity"),
    "nerfstudio": tuple(f"gauss_params.{name}" for name in ("means", "scales", "quats", "opacities")),
    "nerfstudio, whole": tuple(f"_model.gauss_params.{name}" for name in ("means", "scales", "quats", "opacities")),
    "topokit": ("means", "scales", "quaternions", "opacities"),
}


@pytest.mark.parametrize("trainer", NAMES)
def test_every_trainer_s_names_are_understood(trainer: str) -> None:
    stored = stored_dictionary(torus_scene(300))
    renamed = dict(zip(NAMES[trainer], stored.values(), strict=True)) | {"_features_dc": torch.zeros(300, 3)}
    expected = tk.GaussianSplats.from_dict(stored)
    for holder in (renamed, {"step": 3, "splats": renamed}, {"pipeline": renamed}, {"pipeline": {"splats": renamed}}):
        splats = tk.GaussianSplats.from_dict(holder)
        for part in ("means", "scales", "quaternions", "opacities"):
            assert torch.equal(getattr(splats, part), getattr(expected, part)), part


def test_two_dimensional_gaussians_in_a_dictionary_have_a_third_scale_of_zero() -> None:
    stored = stored_dictionary(torus_scene(300))
    splats = tk.GaussianSplats.from_dict({**stored, "scales": stored["scales"][:, :2]})
    torch.testing.assert_close(splats.scales[:, :2], stored["scales"][:, :2].exp())
    assert bool((splats.scales[:, 2] == 0).all())


def test_dictionaries_that_are_no_scene_are_explained() -> None:
    stored = stored_dictionary(torus_scene(50))
    with pytest.raises(InputError, match=r"has means twice, as 'means' and as '_xyz': pass one of them"):
        tk.from_splats({**stored, "_xyz": stored["means"]})
    with pytest.raises(
        InputError, match=r"lacks means, scales, quats, opacities; it has weight, bias\. Expected means"
    ):
        tk.from_splats({"weight": torch.zeros(3), "bias": torch.zeros(3)})
    with pytest.raises(InputError, match="it has no entries"):
        tk.from_splats({})


def test_a_checkpoint_is_opened_as_the_message_advises(tmp_path: Path) -> None:
    stored = stored_dictionary(torus_scene(400))
    path = tmp_path / "ckpt_29999_rank0.pt"
    torch.save({"step": 29999, "splats": stored}, path)
    advice = r"topokit\.from_splats\(torch\.load\(path, weights_only=True\)\)"
    for opener in (tk.from_splats, tk.load):
        with pytest.raises(tk.TopokitError, match=advice):
            opener(path)
    shape = tk.from_splats(torch.load(path, weights_only=True), n_samples=60)
    assert torch.equal(shape.samples.points, tk.from_splats(stored, n_samples=60).samples.points)


def test_splats_are_indexed_like_arrays() -> None:
    splats = splats_of(torus_scene(20))
    mask = splats.means[:, 0] > 0
    for rows, expected in (
        (mask, splats.means[mask]),
        (torch.tensor([3, 1]), splats.means[[3, 1]]),
        (slice(2, 9, 2), splats.means[2:9:2]),
        (-1, splats.means[-1:]),
    ):
        assert torch.equal(splats[rows].means, expected)
    assert [len(one) for one in splats] == [1] * 20


# load


def test_load_tells_splats_meshes_and_points_apart_by_content(tmp_path: Path) -> None:
    import trimesh

    scene = torus_scene(1000)
    write_ply(tmp_path / "splats.ply", scene)
    trimesh.Trimesh(*icosphere(2)).export(tmp_path / "mesh.ply")
    trimesh.PointCloud(scene.means).export(tmp_path / "points.ply")
    assert any("discs" in sentence for sentence in tk.load(tmp_path / "splats.ply").notes)
    assert tk.load(tmp_path / "mesh.ply").counted is not None
    points = tk.load(tmp_path / "points.ply")
    assert points.counted is None
    assert points.samples.n_points == 1000


def test_load_opens_a_folder_and_its_meta_by_the_folder_s_name(tmp_path: Path) -> None:
    write_sog_folder(tmp_path / "robot", torus_scene(500))
    assert tk.load(tmp_path / "robot").name == "robot"
    assert tk.load(tmp_path / "robot" / "meta.json").name == "robot"
    with pytest.raises(tk.TopokitError, match="is a directory"):
        tk.load(tmp_path)


def test_load_hands_options_on(tmp_path: Path) -> None:
    write_splat(tmp_path / "scene.splat", torus_scene(500))
    shape = tk.load(tmp_path / "scene.splat", n_samples=700, n_neighbors=9, component="all")
    assert shape.samples.n_points == 700
    assert shape.n_neighbors == 9
    assert shape.samples.points.dtype == torch.float64


def test_stored_normals_are_never_looked_at(tmp_path: Path) -> None:
    scene = torus_scene(500)
    write_ply(tmp_path / "a.ply", scene)  # the writer stores random normals
    zeros = (
        (tmp_path / "a.ply").read_bytes().replace(b"nx\n", b"ax\n").replace(b"ny\n", b"ay\n").replace(b"nz\n", b"az\n")
    )
    (tmp_path / "b.ply").write_bytes(zeros)
    first, second = (tk.from_splats(tmp_path / name).samples for name in ("a.ply", "b.ply"))
    assert torch.equal(first.points, second.points)
    assert first.frames is not None
    assert second.frames is not None
    assert torch.equal(first.frames, second.frames)


def test_sources_of_other_types_are_named() -> None:
    with pytest.raises(InputError, match="got list"):
        tk.from_splats([1, 2, 3])  # type: ignore[arg-type]
