"""Rotated coefficients have the same colour in rotated directions."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fecocodec.geometry.harmonics import rotated_harmonics
from tests.rendering.brute_force import sh_basis


@pytest.mark.parametrize("degree", [1, 2])
def test_rotation_equals_evaluation_in_rotated_directions(degree: int) -> None:
    generator, count = np.random.default_rng(degree), (degree + 1) ** 2
    higher, directions = generator.normal(size=(5, count - 1, 3)), generator.normal(size=(3, 40))
    directions /= np.linalg.norm(directions, axis=0)
    rotation = Rotation.random(random_state=degree).as_matrix()

    def colours(coefficients: np.ndarray, directions: np.ndarray) -> np.ndarray:
        return np.einsum("kd,nkc->ndc", sh_basis(torch.from_numpy(directions)).numpy()[1:count], coefficients)

    found = colours(rotated_harmonics(higher, rotation), rotation @ directions)
    np.testing.assert_allclose(found, colours(higher, directions), atol=1e-14)
    assert np.abs(found - colours(higher, rotation @ directions)).max() > 1.0
