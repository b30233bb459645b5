"""Pairs of many photographs: those that share features, whatever their names."""

import numpy as np

from fecocodec.poses.likely_pairs import likely_pairs, pairs_to_match_again

STEP, SEEN = 30, 120  # a photograph sees SEEN points; the next one sees the points from STEP further on


def walk(count: int, shuffle: bool = False) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], list[str]]:
    """Return the features of photographs along a row of points, with their names in the order of the walk."""
    generator = np.random.default_rng(0)
    points = generator.gamma(0.4, 100, (count * STEP + SEEN, 128))
    names = [f"{number:03d}" for number in (generator.permutation(count) if shuffle else range(count))]
    features = {}
    for index, name in enumerate(names):
        own = generator.gamma(0.4, 100, (400, 128))  # small features, which only this photograph has
        seen = points[index * STEP :][:SEEN] * generator.uniform(0.8, 1.2, (SEEN, 128))
        scales = np.concatenate((generator.uniform(1, 2, 400), generator.uniform(3, 9, SEEN)))
        features[name] = scales, np.concatenate((own, seen)).clip(0, 255).astype(np.uint8)
    return features, names


def test_all_pairs_of_few_photographs_are_matched_and_of_many_those_that_share_features():
    assert len(likely_pairs(walk(24)[0])) == 24 * 23 // 2
    features, names = walk(60, shuffle=True)
    pairs = likely_pairs(features)
    assert len(pairs) < 60 * 15 and all(first < second for first, second in pairs)
    assert {(min(pair), max(pair)) for step in (1, 2) for pair in zip(names, names[step:], strict=False)} <= set(pairs)


def test_neighbours_by_name_and_best_partners_are_matched():
    features = {name: (np.ones(5), np.eye(5, 128, 5 * int(name), dtype=np.uint8)) for name, _ in walk(25)[0].items()}
    pairs = likely_pairs({name: features[name] for name in reversed(sorted(features))})
    assert {("000", "001"), ("000", "002"), ("022", "024")} <= set(pairs) and len(pairs) < 25 * 13
    counts = {(f"{number:02d}", "x"): 20 + number for number in range(12)} | {("00", "01"): 500}
    assert pairs_to_match_again(counts, {"x", "y"}) == [(f"{number:02d}", "x") for number in range(2, 12)]
