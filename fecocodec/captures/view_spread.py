"""Choose views of a capture by the overlap of their cameras: far apart with a minimum overlap, a few that cover all."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fecocodec.camera_files.posed_photographs import PosedPhotographs, known_pinhole
from fecocodec.captures.view_selection import Selection, Spread
from fecocodec.errors import InputError
from fecocodec.geometry.depth_bounds import bounds_of_depths
from fecocodec.geometry.frustum_overlap import LEAST_BASELINE, NEIGHBOUR_OVERLAP, covisibility_estimate
from fecocodec.limits import MAX_VIEWS
from fecocodec.photographs.framing import framed_intrinsics

MAX_AUTO_VIEWS = 8
# Chosen on 91 training captures: with 8 views, 83% share a measured covisibility of half or more with a neighbour.
LEAST_OVERLAP = 0.75
_OVERLAP_TIE = 0.03  # smaller differences of overlap count as ties
_DEFAULT_DEPTHS = (3.0, 100.0)  # default near and far, in units of the distance between neighbouring cameras
DUPLICATE_OVERLAP = 0.9  # of photographs from one position
Overlap = Float[np.ndarray, "view view"]  # estimated covisibility, in [0, 1]


def spread_views(scene: PosedPhotographs, count: int) -> tuple[int, ...]:
    """Return the indices of `count` views such that neighbours share half of their surfaces, in ascending order.

    Starts with the view of largest total overlap. Then repeatedly adds the view with the smallest overlap with the
    chosen views that is still at least LEAST_OVERLAP, or, if there is none, the view with the largest overlap.
    Raises InputError if `count` exceeds the number of views or is not 1 to MAX_VIEWS.
    """
    require_count(count, len(scene.photographs))
    return tuple(sorted(_grown(scene, count, least_overlap=0.0)))


def auto_views(scene: PosedPhotographs) -> tuple[int, ...]:
    """Return the indices of at most MAX_AUTO_VIEWS views that cover the middle of a capture, in ascending order.

    Like `spread_views`, but omits views with too little overlap with the chosen ones.
    """
    return tuple(sorted(overlapping_views(scene, MAX_AUTO_VIEWS)))


def overlapping_views(scene: PosedPhotographs, most: int) -> list[int]:
    """Return at most `most` views of the middle of a capture, each of which overlaps with those before it."""
    return _grown(scene, min(most, len(scene.photographs)), NEIGHBOUR_OVERLAP)


def require_count(count: int, available: int) -> None:
    """Raise InputError if `count` views cannot be chosen."""
    if not 1 <= count <= available:
        most = min(available, MAX_VIEWS)
        raise InputError(
            f"{count} views asked for, but the folder has {available}; choose 1 to {most}, or name photographs in "
            "`views`, by file names or by numbers with a comma (`0,5` or `7,`)."
        )
    if count > MAX_VIEWS:
        raise InputError(f"{count} views asked for, but at most {MAX_VIEWS} can be used; change `views`.")


def spare_for_checks(
    count: int, views: Selection | None, num_checks: int | None, folder: Path, *, is_named: bool
) -> int:
    """Return how many of `count` photographs can be left for checks. Raises InputError if more are asked for.

    views: that are asked for. num_checks: that are asked for, None for any number. is_named: whether photographs beside
    these are named, to be coded.
    """
    needed = 0 if is_named else views.count if isinstance(views, Spread) else 2
    spare = max(0, count - needed)
    if num_checks is not None and num_checks > spare:
        them = "it" if num_checks == 1 else "them"
        raise InputError(f"{folder}: {too_few(num_checks, 'check', spare)} can be left for {them}; change `checks`.")
    return spare


def too_few(asked_for: int, kind: str, count: int) -> str:
    """Return the beginning of a sentence: so many of a kind are asked for, but `count` photographs."""
    found = f"{count or 'no'} photograph{'' if count < 2 else 's'}"
    return f"{asked_for} {kind}{'' if asked_for == 1 else 's'} asked for, but {found}"


def _grown(scene: PosedPhotographs, count: int, least_overlap: float) -> list[int]:
    overlap, baseline = overlaps_and_baselines(scene)
    centrality = overlap.sum(axis=1)
    chosen = [int(centrality.argmax())]
    while len(chosen) < count:
        others = [index for index in range(len(overlap)) if index not in chosen]
        closest = baseline[np.ix_(others, chosen)].min(axis=1)
        apart = [index for index, distance in zip(others, closest, strict=True) if distance >= LEAST_BASELINE]
        candidates = apart or others
        largest = overlap[np.ix_(candidates, chosen)].max(axis=1)
        best = _best(largest, centrality[candidates])
        if largest[best] < least_overlap:
            break
        chosen.append(candidates[best])
    return chosen


def _best(largest: Float[np.ndarray, " candidate"], centrality: Float[np.ndarray, " candidate"]) -> int:
    """Return the candidate with the smallest sufficient overlap with the chosen views; centrality breaks ties."""
    enough = np.flatnonzero(largest >= LEAST_OVERLAP)
    if not enough.size:
        return int(largest.argmax())
    just_enough = enough[largest[enough] <= largest[enough].min() + _OVERLAP_TIE]
    return int(just_enough[centrality[just_enough].argmax()])


def overlaps_and_baselines(scene: PosedPhotographs) -> tuple[Overlap, Overlap]:
    """Return estimated covisibility, and distances between cameras in units of the depth (harmonic mean)."""
    poses = np.stack([photograph.camera_to_world for photograph in scene.photographs])
    centres = poses[:, :3, 3]
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    near, far = _depth_bounds(scene, distance)
    intrinsics = np.tile(_typical_intrinsics(scene), (len(poses), 1, 1))
    overlap = covisibility_estimate(poses, intrinsics, near, far)
    return overlap, distance * (1 / near + 1 / far) / 2


def overlaps_among(scene: PosedPhotographs, indices: list[int]) -> tuple[Overlap, Overlap]:
    """Return the overlaps and baselines of these photographs, in matrices of all photographs that are 0 elsewhere."""
    of_all = np.zeros((2, len(scene.photographs), len(scene.photographs)))
    if indices:
        within = replace(scene, photographs=[scene.photographs[index] for index in indices])
        rows, columns = np.ix_(indices, indices)
        of_all[:, rows, columns] = overlaps_and_baselines(within)
    return of_all[0], of_all[1]


def known_depth_bounds(scene: PosedPhotographs) -> tuple[float, float] | None:
    """Return near and far of the camera file if they are a range, else of its sparse points; None without either."""
    if scene.near is not None and scene.far is not None and 0 < scene.near < scene.far < np.inf:
        return scene.near, scene.far
    sparse = [photograph.sparse_depths for photograph in scene.photographs]
    return bounds_of_depths(np.concatenate([np.zeros(0), *sparse]))


def _depth_bounds(scene: PosedPhotographs, distance: Float[np.ndarray, "view view"]) -> tuple[float, float]:
    """Return the known bounds of depth, else bounds from distances between cameras."""
    if bounds := known_depth_bounds(scene):
        return bounds
    if len(distance) < 2 or not distance.any():
        return 1.0, 10.0  # all cameras are at one position, so the unit of length does not matter
    apart = np.where(distance > 1e-6 * distance.max(), distance, np.inf)
    step = float(np.median(apart.min(axis=1)))
    return _DEFAULT_DEPTHS[0] * step, _DEFAULT_DEPTHS[1] * step


def _typical_intrinsics(scene: PosedPhotographs) -> Float[np.ndarray, "3 3"]:
    """Return the normalised intrinsics of the first photograph whose lens and size are known."""
    refused: InputError | None = None
    for photograph in scene.photographs:
        try:
            pinhole = known_pinhole(photograph)
        except InputError as error:
            refused = refused or error
            continue
        return framed_intrinsics(pinhole, (pinhole.height, pinhole.width))
    raise refused or InputError(f"{scene.cameras_path}: no photographs; give the folder that holds them.")


def k_centres(overlap: Overlap, chosen: list[int], candidates: list[int], count: int) -> list[int]:
    """Return up to `count` candidates, each the one that overlaps least with those chosen before (greedy k-centre).

    chosen: views from which the choice starts; without any, it starts with the candidate of largest total overlap.
    """
    chosen, rest, found = list(chosen), list(candidates), list[int]()
    while rest and len(found) < count:
        if chosen:
            best = int(overlap[np.ix_(rest, chosen)].max(axis=1).argmin())
        else:
            best = int(overlap[np.ix_(rest, rest)].sum(axis=1).argmax())
        found.append(rest.pop(best))
        chosen.append(found[-1])
    return found


def within_reach(overlap: Overlap, indices: Iterable[int], of: list[int]) -> list[int]:
    """Return which photographs overlap enough with one of others."""
    return [index for index in indices if overlap[index, of].max(initial=0.0) >= NEIGHBOUR_OVERLAP]


def with_neighbours(overlap: Overlap, indices: list[int]) -> list[int]:
    """Return which photographs overlap enough with another of them."""
    of_others = overlap - np.diag(np.diagonal(overlap))
    return within_reach(of_others, indices, indices)


def spread_over(overlap: Overlap, candidates: list[int], count: int) -> list[int]:
    """Return photographs spread over the poses: the most central one of each of `count` neighbourhoods."""
    centres = k_centres(overlap, [], candidates, count)
    if not centres:
        return []
    nearest = overlap[np.ix_(candidates, centres)].argmax(axis=1)
    groups = [[index for index, own in zip(candidates, nearest, strict=True) if own == group] for group in set(nearest)]
    return sorted(group[int(overlap[np.ix_(group, group)].sum(axis=1).argmax())] for group in groups)


def is_duplicate(overlap: Float[np.ndarray, " view"], baseline: Float[np.ndarray, " view"]) -> bool:
    """Return whether a photograph shows what a coded one shows, from the same position."""
    return bool(((baseline < LEAST_BASELINE) & (overlap >= DUPLICATE_OVERLAP)).any())
