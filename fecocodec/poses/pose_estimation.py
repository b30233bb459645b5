"""Estimate the cameras of 2 to 200 photographs of a static scene with pycolmap (optional extra `poses`).

SIFT features, matching of all pairs or of likely ones, incremental reconstruction, and a last bundle adjustment with a
robust loss. The initialisation is loosened step by step, because few views give few points and small angles. Method:
Schönberger and Frahm, "Structure-from-Motion Revisited", 2016. The reconstruction is repeated from other initial focal
lengths, and the best is taken (`estimate_choice`). Guided matching takes long, so it is left to two photographs, and to
those that are not registered without it. If two are registered, their cameras are fitted again from many starting
directions (`two_photographs`).
"""

import shutil
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from fecocodec.photographs.image_headers import read_image_size
from fecocodec.poses.estimate_choice import (
    Estimate,
    MatchedPoints,
    best_estimate,
    cut_weak_links,
    least_difference,
    least_explained,
)
from fecocodec.poses.estimated_cameras import ImageGroup, Reconstruction, cameras_of, median_angle
from fecocodec.poses.likely_pairs import Pair, likely_pairs, pairs_to_match_again
from fecocodec.poses.pose_warnings import is_agreement
from fecocodec.poses.pycolmap_matching import (
    FeaturePoints,
    MatchedFeatures,
    extract_features,
    forget_matches,
    match_pairs,
    reached_points,
    read_features,
    read_points,
    verified_matches,
)
from fecocodec.poses.pycolmap_steps import load_pycolmap, map_photographs, refine, set_focal_lengths
from fecocodec.poses.turned_camera import only_turned
from fecocodec.poses.two_photographs import reconstruct_pair
from fecocodec.poses.two_view_fit import Points

LEAST_ANGLE = 1.0  # degrees, median angle between the rays of a point; with less, depth is not determined
# Smallest angle (degrees) and number of inliers of the first pair, and number of inliers of a further photograph.
_ATTEMPTS = ((8.0, 60, 24), (4.0, 40, 18), (2.0, 25, 14), (1.0, 20, 12))
LEAST_MATCHES, LEAST_POINTS = _ATTEMPTS[-1][1:]
_ALL_ATTEMPTS_UP_TO = 20  # photographs; of more, the first and the last attempt are made
_STARTS = (1.0, 4 / 3, 0.6)  # initial focal lengths of the estimates, relative to that of EXIF data or a usual lens
_ALL_STARTS_UP_TO = 12  # photographs; two estimates of few can agree and be wrong
_NEARLY_ALL = 0.9  # of the photographs


def reconstruct(
    folder: Path, groups: list[ImageGroup], workspace: Path, num_threads: int = -1, masks: Path | None = None
) -> Reconstruction:
    """Reconstruct the photographs in `folder`. workspace: an empty folder for the database.

    masks: as for `extract_features`. num_threads: of features and matching, -1 for all cores; the cameras do not depend
    on it. Raises InputError if pycolmap is missing; the result has no cameras if no pair of photographs can be
    reconstructed.
    """
    pycolmap = load_pycolmap()
    database = workspace / "database.db"
    pycolmap.Database.open(database).close()  # creates it
    extract_features(pycolmap, database, folder, groups, num_threads, masks)
    features = read_points(pycolmap, database)
    if _is_turned(pycolmap, database, folder, groups, features, num_threads):
        return Reconstruction((), 0.0, 0.0, _counts(verified_matches(pycolmap, database)), None, is_turned=True)
    pairs, is_pair = likely_pairs(read_features(pycolmap, database)), len(features) == 2
    match_pairs(pycolmap, database, pairs, num_threads, is_guided=is_pair)
    matches = verified_matches(pycolmap, database)
    points = _all_points(features, matches)
    estimates = _estimates(pycolmap, database, folder, workspace / "once", groups, points, [], num_threads)
    registered = max((one.names for one in estimates), key=len, default=frozenset())
    if not is_pair and (again := pairs_to_match_again(_counts(matches), set(features) - registered)):
        forget_matches(pycolmap, database, again)
        match_pairs(pycolmap, database, again, num_threads, is_guided=True)
        matches = verified_matches(pycolmap, database)
        points = _all_points(features, matches)
        estimates = _estimates(pycolmap, database, folder, workspace / "again", groups, points, estimates, num_threads)
    if not estimates:
        return Reconstruction((), 0.0, 0.0, _counts(matches), None)
    best = best_estimate(estimates, points)
    found = Reconstruction(
        best.cameras,
        best.model.compute_mean_reprojection_error(),
        median_angle(best.model),
        _counts(matches),
        least_difference(best, estimates),
        reached=reached_points(best.model, matches),
        explained=least_explained(best.cameras, points),
    )
    if len(best.cameras) > 2:
        return found
    starts = [one.cameras for one in estimates if one.names == best.names]
    return reconstruct_pair(found, starts, points[best.cameras[0].name, best.cameras[1].name], groups)


def _estimates(
    pycolmap: Any,
    database: Path,
    folder: Path,
    workspace: Path,
    groups: list[ImageGroup],
    points: MatchedPoints,
    earlier: list[Estimate],
    num_threads: int,
) -> list[Estimate]:
    """Return `earlier` and estimates from several initial focal lengths, the first two of which run side by side.

    With more than _ALL_STARTS_UP_TO photographs, two that agree on nearly all photographs are enough. For two
    photographs, two estimates start their fit. With fixed focal lengths, two differ in the choice of the first pair.
    """
    is_fixed = any(group.is_fixed for group in groups)
    count = sum(len(group.names) for group in groups)
    num_matches = sum(len(first) for first, _ in points.values())
    attempts = _ATTEMPTS if count <= _ALL_ATTEMPTS_UP_TO else (_ATTEMPTS[0], _ATTEMPTS[-1])

    def estimate(number: int) -> list[Estimate]:
        place = workspace / str(number)
        place.mkdir(parents=True)
        own = Path(shutil.copy(database, place))
        if not is_fixed:
            set_focal_lengths(pycolmap, own, [_STARTS[number] * group.focal_px for group in groups])
        tried = attempts[-1:] if number or earlier else attempts
        model = map_photographs(pycolmap, own, folder, place, tried, num_matches, count, is_focal_fixed=is_fixed)
        if model is None:
            return []
        model = refine(pycolmap, model, count, is_focal_fixed=is_fixed)
        if cut_weak_links(model, points):
            model = refine(pycolmap, model, count, is_focal_fixed=is_fixed)
        return [Estimate(cameras_of(model), model)]

    # pycolmap maps without Python's lock.
    with ThreadPoolExecutor(1 if num_threads == 1 else 2) as threads:
        estimates = [*earlier, *chain(*threads.map(estimate, range(2)))]
    last = 1
    if not (is_fixed or count == 2 or (count > _ALL_STARTS_UP_TO and _is_confirmed(estimates, points, count))):
        last = 2
        estimates += estimate(last)
    if not is_fixed:  # guided matches, if they follow, are verified with it
        set_focal_lengths(pycolmap, database, [_STARTS[last] * group.focal_px for group in groups])
    return estimates


def _is_confirmed(estimates: list[Estimate], points: MatchedPoints, count: int) -> bool:
    """Return whether the best estimate has nearly all photographs, and another one agrees with it."""
    if not estimates:
        return False
    best = best_estimate(estimates, points)
    return is_agreement(least_difference(best, estimates)) and len(best.cameras) >= _NEARLY_ALL * count


def _is_turned(
    pycolmap: Any,
    database: Path,
    folder: Path,
    groups: list[ImageGroup],
    features: dict[str, FeaturePoints],
    num_threads: int,
) -> bool:
    """Return whether the camera only turned between the photographs, before most pairs are matched."""

    def matched(first: str, second: str) -> tuple[Points, Points]:
        match_pairs(pycolmap, database, [(first, second)], num_threads, is_guided=True)
        found = _all_points(features, verified_matches(pycolmap, database))
        points = found.get((first, second), (np.zeros((0, 2)), np.zeros((0, 2))))
        return points[0] - centre_of[first], points[1] - centre_of[second]

    names = sorted(features)
    centre_of = {name: np.array(read_image_size(folder / name)[::-1]) / 2 for name in names}
    focal_px = {name: group.focal_px for group in groups for name in group.names}
    return only_turned(names, matched, focal_px)


def _all_points(features: dict[str, FeaturePoints], matches: dict[Pair, MatchedFeatures]) -> MatchedPoints:
    return {
        (first, second): (features[first][numbers[:, 0]], features[second][numbers[:, 1]])
        for (first, second), numbers in matches.items()
    }


def _counts(matches: dict[Pair, MatchedFeatures]) -> dict[Pair, int]:
    return {pair: len(numbers) for pair, numbers in matches.items()}
