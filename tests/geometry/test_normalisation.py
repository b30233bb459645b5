"""The normalised frame does not depend on the unit and the origin of the world frame.

Quaternion functions agree with scipy.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.normalisation import denormalise_gaussians, normalise_scene
from fecocodec.geometry.rotations import matrix_from_quaternion, multiply, quaternion_from_matrix
from tests.example_scenes import example_cameras


def in_unit(cameras: Cameras, unit: float) -> Cameras:
    extrinsics = cameras.extrinsics.clone()
    extrinsics[:, :3, 3] *= unit
    return replace(cameras, extrinsics=extrinsics, near=cameras.near * unit, far=cameras.far * unit)


def gaussians_at(points: torch.Tensor) -> Gaussians:
    n = len(points)
    rotations = torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(n, 1)
    return Gaussians(points, torch.full((n, 3), 0.25), rotations, torch.full((n,), 0.5), torch.zeros(n, 1, 3))


def test_near_is_one_on_the_grid_of_the_specification_wherever_the_origin_is() -> None:
    cameras = example_cameras(4)
    normalised, _ = normalise_scene(cameras)
    assert float(normalised.near) == 1.0
    torch.testing.assert_close(normalised.far, cameras.far / cameras.near, atol=0, rtol=2.0**-11)
    torch.testing.assert_close(normalised.extrinsics[:, :3, 3].mean(dim=0), torch.zeros(3), atol=2.0**-14, rtol=0)
    assert torch.equal(normalised.extrinsics[:, :3, :3], cameras.extrinsics[:, :3, :3])
    centres = 2.0**13 * normalised.extrinsics[:, :3, 3]
    assert torch.equal(centres, centres.round())
    mantissa, _ = torch.frexp(normalised.far)
    assert float(2.0**11 * mantissa) == round(float(2.0**11 * mantissa))
    extrinsics = cameras.extrinsics.clone()
    extrinsics[:, :3, 3] = (extrinsics[:, :3, 3] * 8).round() / 8  # so that sums with 1e6 are exact in float32
    here, far_off = replace(cameras, extrinsics=extrinsics), replace(cameras, extrinsics=extrinsics.clone())
    far_off.extrinsics[:, :3, 3] += 1e6
    for one, other in zip(normalise_scene(here)[0].fields(), normalise_scene(far_off)[0].fields(), strict=True):
        assert torch.equal(one, other)


@pytest.mark.parametrize("unit", [1e-3, 1e3, 2.0**20])
def test_the_unit_of_length_does_not_matter(unit: float) -> None:
    metres, others = normalise_scene(example_cameras(4)), normalise_scene(in_unit(example_cameras(4), unit))
    for one, other in zip(metres[0].fields(), others[0].fields(), strict=True):
        assert torch.equal(one, other)
    assert others[1].scale == pytest.approx(metres[1].scale * unit)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_denormalising_is_the_way_back(unit: float) -> None:
    cameras = in_unit(example_cameras(4), unit)
    normalised, frame = normalise_scene(cameras)
    back = denormalise_gaussians(gaussians_at(normalised.extrinsics[:, :3, 3]), frame)
    torch.testing.assert_close(back.means, cameras.extrinsics[:, :3, 3], atol=1.5 * 2.0**-14 * unit, rtol=1e-6)
    torch.testing.assert_close(back.scales, torch.full((4, 3), 0.25 * float(cameras.near)))


def assert_same_rotation(quaternion: torch.Tensor, expected: Rotation) -> None:
    wxyz = quaternion.double().numpy()
    np.testing.assert_allclose(np.linalg.norm(wxyz, axis=-1), 1.0, atol=1e-6)
    found = Rotation.from_quat(wxyz[..., [1, 2, 3, 0]])
    assert float((found * expected.inv()).magnitude().max()) < 1e-6


def test_quaternions_are_those_of_scipy() -> None:
    rotations = Rotation.random(500, random_state=0)
    quaternions = quaternion_from_matrix(torch.from_numpy(rotations.as_matrix()))
    assert_same_rotation(quaternions, rotations)
    assert bool((quaternions[:, 0] >= 0).all())
    axes = np.concatenate((np.eye(3), -np.eye(3), np.random.default_rng(0).normal(size=(50, 3)), np.zeros((1, 3))))
    lengths = np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-12)
    rotations = Rotation.from_rotvec(np.pi * axes / lengths)
    assert_same_rotation(quaternion_from_matrix(torch.from_numpy(rotations.as_matrix())), rotations)
    left, right = Rotation.random(100, random_state=1), Rotation.random(100, random_state=2)
    quaternions = (quaternion_from_matrix(torch.from_numpy(r.as_matrix())) for r in (left, right))
    assert_same_rotation(multiply(*quaternions), left * right)
    matrices = torch.from_numpy(Rotation.random(100, random_state=3).as_matrix())
    torch.testing.assert_close(matrix_from_quaternion(quaternion_from_matrix(matrices)), matrices)
