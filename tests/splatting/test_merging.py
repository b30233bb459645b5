"""Merging at the receiver: which Gaussians are merged, and which properties a merged Gaussian preserves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from hypothesis import given, settings
from hypothesis import strategies as st

from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.merging.grouping import DEFAULT_MERGING as CONFIG
from fecocodec.merging.grouping import MergingConfig
from fecocodec.merging.moment_matching import (
    Mixture,
    adjugate_form,
    dilogarithm,
    from_axes,
    merged_groups,
    projected_areas,
    to_axes,
)
from fecocodec.receiver.decode import decode
from fecocodec.rendering.rasterizer import render
from fecocodec.splatting.emission import merged
from tests.example_scenes import cameras_in_a_row, surface

SCENE = Path(__file__).parents[2] / "bitstream_spec" / "vectors" / "valid" / "scene-compact-6.fcs"
SIDE = 32  # Gaussians a side


CAMERA = cameras_in_a_row(0.0)


def wall(grey: torch.Tensor, depth: torch.Tensor) -> Gaussians:
    """Return one Gaussian per grid cell of one view. grey, depth: [SIDE SIDE]."""
    flat = surface(CAMERA, depth[None], grey[None, ..., None].expand(-1, -1, -1, 3), 0.3)
    scales = 1.5 * flat.scales * torch.tensor([1.0, 1.0, 0.2])
    return replace(flat, scales=scales, harmonics=F.pad(flat.harmonics, (0, 0, 0, 3)))


def merge_all(gaussians: Gaussians, config: MergingConfig = CONFIG) -> Gaussians:
    return merged(gaussians, torch.ones(gaussians.count, dtype=torch.bool), (SIDE, SIDE), CAMERA, config)


def flat(value: float) -> torch.Tensor:
    return torch.full((SIDE, SIDE), value)


def noise(deviation: float) -> torch.Tensor:
    return deviation * torch.randn(SIDE, SIDE, generator=torch.Generator().manual_seed(3))


def test_uniform_walls_are_merged_and_texture_is_kept() -> None:
    assert merge_all(wall(flat(0.6), flat(4.0))).count == (SIDE // 4) ** 2
    before = wall(0.5 + noise(0.2), flat(4.0))
    assert merge_all(before).count > 0.95 * before.count
    before = wall(0.5 + noise(0.1), flat(4.0))
    after = merge_all(before, replace(CONFIG, largest_cost=0.0))
    assert all(torch.equal(a, b) for a, b in zip(after.fields(), before.fields(), strict=True))


def mean_squared_difference(first: Gaussians, second: Gaussians) -> float:
    """Return the mean squared difference of renderings, without their borders."""
    images = [render(g, CAMERA, (2 * SIDE, 2 * SIDE)).color[..., 8:-8, 8:-8] for g in (first, second)]
    return float((images[0] - images[1]).square().mean())


def test_a_nearly_uniform_opaque_wall_looks_the_same() -> None:
    before = wall(0.6 + noise(0.003), flat(4.0))
    before = replace(before, opacities=torch.full_like(before.opacities, 0.9))
    after = merge_all(before)
    assert after.count < 0.1 * before.count
    assert mean_squared_difference(before, after) < 1e-4


def test_receivers_that_round_differently_agree_within_50_db() -> None:
    """At costs near the bound, rounding errors determine which cells are merged."""
    before = wall(0.5 + noise(0.05), 4.0 + noise(0.2))
    other = replace(before, means=before.means * (1.0 + 1e-6), opacities=before.opacities * (1.0 - 1e-5))
    assert 0.2 * before.count < merge_all(before).count < 0.8 * before.count
    assert mean_squared_difference(merge_all(before), merge_all(other)) < 1e-5


def test_colours_do_not_mix_across_an_edge() -> None:
    grey, depth = flat(0.2), flat(3.0)
    grey[:, SIDE // 2 + 1 :], depth[:, SIDE // 2 + 1 :] = 0.8, 6.0  # the edge runs through a column of cells
    after = merge_all(wall(grey, depth))
    shades = 0.5 + SH_DEGREE_0 * after.harmonics[:, 0, 0]
    assert torch.minimum((shades - 0.2).abs(), (shades - 0.8).abs()).max() < 0.01
    assert torch.minimum((after.means[:, 2] - 3.0).abs(), (after.means[:, 2] - 6.0).abs()).max() < 0.01


def test_a_group_has_the_moments_of_its_members_across_the_ray() -> None:
    eye, weights = np.zeros(3, np.float32), np.array([1.0, 2.0, 3.0, 4.0], np.float32)
    is_corner = torch.zeros(SIDE, SIDE, dtype=torch.bool)
    is_corner[:2, :2] = True
    corner = wall(flat(0.6), 4.0 + noise(0.1)).keep(is_corner.reshape(-1))
    fields = tuple(field.numpy() for field in corner.fields())
    mixture = Mixture(fields, eye, 0.05 * weights[::-1], weights, np.float32(SIDE * SIDE))
    heads, (means, scales, rotations, opacities, harmonics) = merged_groups(mixture, np.full(4, 2))

    share = torch.from_numpy(weights / weights.sum())
    mean = share @ corner.means
    offsets, ray = corner.means - mean, mean / mean.norm()
    offsets = offsets - (offsets @ ray)[:, None] * ray
    covariance = torch.diag(share @ corner.scales**2) + torch.einsum("m,mi,mj->ij", share, offsets, offsets)
    assert heads.tolist() == [2]
    np.testing.assert_allclose(means[0], mean, rtol=1e-6)
    entries = covariance[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]].numpy()
    found = from_axes(scales, rotations)
    np.testing.assert_allclose(found[:, 0], entries, rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(harmonics[0], torch.einsum("m,mkc->kc", share, corner.harmonics), rtol=1e-5)
    assert dilogarithm(opacities) * projected_areas(means, found, np.float32(SIDE * SIDE)) == pytest.approx(
        0.5, rel=1e-3
    )


def test_the_integral_of_optical_depth_is_kept() -> None:
    before = wall(flat(0.6), flat(4.0))

    def optical_depth(gaussians: Gaussians) -> float:
        size = (8 * SIDE, 8 * SIDE)  # fine enough to make the renderer's low-pass filter negligible
        return float(-torch.log1p(-render(gaussians, CAMERA, size).alpha[..., 32:-32, 32:-32].double()).mean())

    assert optical_depth(merge_all(before)) == pytest.approx(optical_depth(before), rel=0.03)


def test_gaussians_that_are_not_present_are_dropped_whatever_they_hold() -> None:
    before = wall(flat(0.6), flat(4.0))
    is_present = torch.ones(before.count, dtype=torch.bool)
    is_present[5 : SIDE * SIDE // 2 : 7] = False
    damaged = before.means.clone()
    damaged[~is_present] = torch.nan
    after = merged(replace(before, means=damaged), is_present, (SIDE, SIDE), CAMERA, CONFIG)
    assert after.count < 0.8 * int(is_present.sum())
    assert all(field.isfinite().all() for field in after.fields())


def test_the_edge_of_a_cut_out_is_kept() -> None:
    """Beside absent Gaussians, whatever is behind would show through a changed shape."""
    before = wall(flat(0.6), flat(4.0))
    is_inside = torch.zeros(SIDE, SIDE, dtype=torch.bool)
    is_inside[9:-9, 9:-9] = True
    after = merged(before, is_inside.reshape(-1), (SIDE, SIDE), CAMERA, CONFIG)
    edge = before.keep((is_inside & ~is_inside.roll(1, 0) | is_inside & ~is_inside.roll(-1, 1)).reshape(-1))
    rows = {row.numpy().tobytes() for row in after.means}
    assert all(row.numpy().tobytes() in rows for row in edge.means)
    assert after.count < 0.7 * int(is_inside.sum())


def test_the_unit_of_length_does_not_matter() -> None:
    before = wall(0.5 + noise(0.05), 4.0 + noise(0.2))
    longer = replace(before, means=1000.0 * before.means, scales=1000.0 * before.scales)
    assert abs(merge_all(longer).count - merge_all(before).count) <= 2


@settings(deadline=None)
@given(st.lists(st.floats(1e-3, 1e2), min_size=3, max_size=3), st.lists(st.floats(-1, 1), min_size=4, max_size=4))
def test_axes_and_covariances_are_inverse(scales: list[float], rotation: list[float]) -> None:
    quaternion = np.array([rotation], np.float32)
    quaternion[0, 0] += 2.0
    quaternion /= np.linalg.norm(quaternion)
    covariance = from_axes(np.array([scales], np.float32), quaternion)
    again = from_axes(*to_axes(covariance))
    np.testing.assert_allclose(again, covariance, rtol=0, atol=2e-6 * max(scales) ** 2)


def test_the_adjugate_form_is_the_determinant_times_the_inverse_form() -> None:
    factor, vectors = (np.random.default_rng(5).normal(size=(20, 3, columns)) for columns in (3, 1))
    matrices = factor @ factor.swapaxes(1, 2)
    expected = np.linalg.det(matrices) * (vectors.swapaxes(1, 2) @ np.linalg.solve(matrices, vectors))[:, 0, 0]
    entries = matrices[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]].T
    np.testing.assert_allclose(adjugate_form(entries, vectors[..., 0]), expected, rtol=1e-6)


def test_decode_merges_by_default_and_leaves_the_other_gaussians_unchanged() -> None:
    data = SCENE.read_bytes()
    fewer, every = decode(data).gaussians, decode(data, merging=None).gaussians
    assert fewer.count < 0.95 * every.count
    rows = {row.numpy().tobytes() for row in every.means}
    unchanged = sum(row.numpy().tobytes() in rows for row in fewer.means)
    assert 0 < unchanged < fewer.count
