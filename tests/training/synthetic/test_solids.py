"""Rays against solids, compared with points on a fine march along the ray."""

import numpy as np
import pytest

from fecocodec.training.synthetic.raycast import intersect
from fecocodec.training.synthetic.solids import BOX, CONE, CYLINDER, ELLIPSOID

STEPS = np.linspace(-6, 6, 24001)


def is_inside(kind: int, points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    if kind == BOX:
        return np.abs(points).max(-1) <= 1
    if kind == ELLIPSOID:
        return (points**2).sum(-1) <= 1
    radius = 1.0 if kind == CYLINDER else (y + 1) / 2
    return (np.abs(y) <= 1) & (np.hypot(x, z) <= radius)


@pytest.mark.parametrize("kind", [BOX, ELLIPSOID, CYLINDER, CONE])
def test_interval_is_where_the_ray_is_inside(kind: int) -> None:
    rng = np.random.default_rng(kind)
    num_hits = 0
    for _ in range(120):
        origin = rng.normal(0, 1.2, 3)
        direction = rng.normal(0, 1, 3)
        direction /= np.linalg.norm(direction)
        start, end = intersect(float(kind), *origin, *direction)
        inside = is_inside(kind, origin + STEPS[:, None] * direction)
        if inside.sum() < 2:
            assert end - start < 2e-3
            continue
        num_hits += 1
        assert start == pytest.approx(STEPS[inside][0], abs=1e-3)
        assert end == pytest.approx(STEPS[inside][-1], abs=1e-3)
    assert num_hits >= 15
