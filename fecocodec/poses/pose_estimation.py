"""Estimate the cameras of 2 to 60 photographs of a static scene with pycolmap (optional extra `poses`).

SIFT features, exhaustive matching, incremental reconstruction, and a last bundle adjustment with a robust loss. The
initialisation is loosened step by step, because few views give few points and small angles. Method: Schönberger and
Frahm, "Structure-from-Motion Revisited", 2016. If two photographs are registered, their cameras are fitted again from
many starting directions (`two_photographs`).
"""

from pathlib import Path
from typing import Any

import numpy as np

from fecocodec.photographs.image_headers import read_image_size
from fecocodec.poses.estimated_cameras import ImageGroup, Reconstruction, cameras_of, median_angle, pose_difference
from fecocodec.poses.pycolmap_steps import (
    change_focal_lengths,
    extract_features,
    load_pycolmap,
    map_photographs,
    match_features,
    match_pair,
    matched_points,
    refine,
    verified_matches,
)
from fecocodec.poses.turned_camera import Points, only_turned
from fecocodec.poses.two_photographs import reconstruct_pair

LEAST_ANGLE = 1.0  # degrees, median angle between the rays of a point; with less, depth is not determined
# Smallest angle (degrees) and number of inliers of the first pair, and number of inliers of a further photograph.
_ATTEMPTS = ((8.0, 60, 24), (4.0, 40, 18), (2.0, 25, 14), (1.0, 20, 12))
_OTHER_FOCAL = 4 / 3  # initial focal length of the second estimate, relative to the first


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
    if _is_turned(pycolmap, database, folder, groups, workspace, num_threads):
        return Reconstruction((), 0.0, 0.0, verified_matches(pycolmap, database), None, is_turned=True)
    match_features(pycolmap, database, num_threads)
    matches = verified_matches(pycolmap, database)
    count = sum(len(group.names) for group in groups)
    is_fixed = any(group.is_fixed for group in groups)

    def mapped(name: str, attempts: tuple[tuple[float, int, int], ...]) -> Any:
        output = workspace / name
        return map_photographs(pycolmap, database, folder, output, attempts, matches, count, is_focal_fixed=is_fixed)

    best = mapped("first", _ATTEMPTS)
    if best is None:
        return Reconstruction((), 0.0, 0.0, matches, None)
    refined = refine(pycolmap, best, count, is_focal_fixed=is_fixed)
    cameras = cameras_of(refined)
    if not is_fixed:
        change_focal_lengths(pycolmap, database, _OTHER_FOCAL)
    second = mapped("second", _ATTEMPTS[-1:])
    others = None if second is None else cameras_of(refine(pycolmap, second, count, is_focal_fixed=is_fixed))
    difference = None if others is None else pose_difference(cameras, others)
    error, angle = refined.compute_mean_reprojection_error(), median_angle(refined)
    found = Reconstruction(cameras, error, angle, matches, difference)
    if len(cameras) > 2:
        return found
    names = cameras[0].name, cameras[1].name
    points = matched_points(pycolmap, database, *names)
    return reconstruct_pair(found, others if difference is not None else None, points, groups)


def _is_turned(
    pycolmap: Any, database: Path, folder: Path, groups: list[ImageGroup], workspace: Path, num_threads: int
) -> bool:
    """Return whether the camera only turned between the photographs, before most pairs are matched.

    A list of pairs cannot hold names with spaces; the answer is then no.
    """
    names = sorted(name for group in groups for name in group.names)
    if any(name.split() != [name] or name.startswith("#") for name in names):
        return False

    def matched(first: str, second: str) -> tuple[Points, Points]:
        match_pair(pycolmap, database, first, second, workspace / "pair.txt", num_threads)
        points = matched_points(pycolmap, database, first, second)
        return points[0] - centre_of[first], points[1] - centre_of[second]

    centre_of = {name: np.array(read_image_size(folder / name)[::-1]) / 2 for name in names}
    focal_px = {name: group.focal_px for group in groups for name in group.names}
    return only_turned(names, matched, focal_px)
