"""Quaternion functions agree with scipy."""

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from fecocodec.geometry.rotations import matrix_from_quaternion, multiply, quaternion_from_matrix


def assert_same_rotation(quaternion: torch.Tensor, expected: Rotation) -> None:
    wxyz = quaternion.double().numpy()
    np.testing.assert_allclose(np.linalg.norm(wxyz, axis=-1), 1.0, atol=1e-6)
    found = Rotation.from_quat(wxyz[..., [1, 2, 3, 0]])
    assert float((found * expected.inv()).magnitude().max()) < 1e-6


def test_random_rotations() -> None:
    rotations = Rotation.random(500, random_state=0)
    quaternions = quaternion_from_matrix(torch.from_numpy(rotations.as_matrix()))
    assert_same_rotation(quaternions, rotations)
    assert bool((quaternions[:, 0] >= 0).all())


def test_half_turns_about_any_axis_and_the_identity() -> None:
    axes = np.concatenate((np.eye(3), -np.eye(3), np.random.default_rng(0).normal(size=(50, 3)), np.zeros((1, 3))))
    lengths = np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-12)
    rotations = Rotation.from_rotvec(np.pi * axes / lengths)
    assert_same_rotation(quaternion_from_matrix(torch.from_numpy(rotations.as_matrix())), rotations)


def test_products_follow_the_order_of_matrices() -> None:
    left, right = Rotation.random(100, random_state=1), Rotation.random(100, random_state=2)
    quaternions = (quaternion_from_matrix(torch.from_numpy(r.as_matrix())) for r in (left, right))
    assert_same_rotation(multiply(*quaternions), left * right)


def test_the_matrix_of_a_quaternion_is_the_inverse_of_the_quaternion_of_a_matrix() -> None:
    matrices = torch.from_numpy(Rotation.random(100, random_state=3).as_matrix())
    torch.testing.assert_close(matrix_from_quaternion(quaternion_from_matrix(matrices)), matrices)
