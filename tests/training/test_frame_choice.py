"""Context and target frames of captures: overlap, baseline, and overlap from poses alone."""

import numpy as np
from scipy.spatial.transform import Rotation

from fecocodec.geometry.frustum_overlap import frustum_overlap
from fecocodec.training.photographs import LEAST_OVERLAP, choose_frames, context_pairs, relative_baselines

LENS = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])


def cameras(positions: list[float], turns_deg: list[float] | None = None) -> np.ndarray:
    """Camera-to-world of cameras along x that look along z, turned about the vertical."""
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, 0, 3] = positions
    if turns_deg is not None:
        poses[:, :3, :3] = Rotation.from_euler("y", np.array(turns_deg)[:, None], degrees=True).as_matrix()
    return poses


def overlap_of(poses: np.ndarray, near: float = 4.0, far: float = 6.0) -> np.ndarray:
    return frustum_overlap(poses, np.tile(LENS, (len(poses), 1, 1)), near, far)


def test_overlap_falls_with_distance_to_nothing_and_is_symmetric() -> None:
    overlap = overlap_of(cameras([0.0, 1.0, 2.5, 20.0]))
    assert np.array_equal(overlap, overlap.T) and np.array_equal(np.diag(overlap), np.ones(4))
    assert overlap[0, 1] > overlap[0, 2] > overlap[0, 3] == 0.0
    # A step of one at depth d hides a strip of width 1/d: about 0.2 of the image between 4 and 6.
    assert abs(overlap[0, 1] - 0.8) < 0.07


def test_cameras_back_to_back_see_nothing_of_each_other() -> None:
    assert overlap_of(cameras([0.0, 0.0], [0.0, 180.0]))[0, 1] == 0.0


def test_overlap_does_not_depend_on_the_unit_of_length() -> None:
    poses = cameras([0.0, 0.5, 1.3], [0.0, 5.0, -8.0])
    larger = poses.copy()
    larger[:, :3, 3] *= 1000.0
    np.testing.assert_allclose(overlap_of(poses), overlap_of(larger, 4000.0, 6000.0), atol=0.02)


def test_pairs_from_one_place_are_not_taken_though_they_overlap() -> None:
    poses = cameras([0.0, 0.001, 1.5], [0.0, 15.0, 0.0])
    overlap, baselines = overlap_of(poses), relative_baselines(poses, 4.0, 6.0)
    assert LEAST_OVERLAP < overlap[0, 1] < 0.9
    assert (0, 1) not in context_pairs(overlap, baselines) and (0, 2) in context_pairs(overlap, baselines)
    np.testing.assert_allclose(baselines[0, 2], 1.5 / 4.8)


def test_the_best_pair_is_taken_where_none_is_good() -> None:
    overlap = np.array([[1.0, 0.1, 0.05], [0.1, 1.0, 0.2], [0.05, 0.2, 1.0]])
    assert context_pairs(overlap, np.ones((3, 3))) == [(1, 2)]


def test_frames_are_connected_and_come_in_both_orders() -> None:
    poses = cameras([0.4 * index for index in range(12)])
    overlap = overlap_of(poses)
    pairs = context_pairs(overlap, relative_baselines(poses, 4.0, 6.0))
    orders = set()
    for seed in range(30):
        frames = choose_frames(np.random.default_rng(seed), overlap, pairs, 3, 2)
        context, targets = frames[:3], frames[3:]
        assert len(set(context)) == 3 and not set(context) & set(targets)
        assert all(max(overlap[frame, other] for other in context if other != frame) > 0.3 for frame in context)
        assert all(np.sort(overlap[context, target])[-2] > LEAST_OVERLAP for target in targets)
        orders.add(context[0] < context[1])
    assert orders == {True, False}
