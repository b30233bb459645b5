"""Warnings about views that will give a poor reconstruction, from cameras and images alone, without networks."""

from collections import Counter

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, camera_to_world_points, pixel_rays
from fecocodec.geometry.coding_grid import grid_size
from fecocodec.geometry.depth_range import believable_bounds, neighbour_pairs
from fecocodec.geometry.pose_check import Fit, fit_of
from fecocodec.geometry.sparse_matches import find_corners, match_corners
from fecocodec.geometry.views import Views, joined
from fecocodec.sender.optimisation_config import OptimisationConfig, config_of_effort

LEAST_PARALLAX_DEGREES = 0.5  # between the viewing rays of a typical point: about two pixels of a 256-pixel image
LEAST_OVERLAP = 0.2  # fraction of the sample points of a view that another view sees
LARGEST_DEPTH_RATIO = 1000.0  # far / near
LARGEST_PIXEL_RATIO = 1.5  # between the sides of a pixel
MOST_AHEAD = 5.0  # times that near may be nearer than what is believable; that costs about 1 dB at new views
DARKEST, BRIGHTEST = 0.04, 0.96  # mean sRGB value of all views
# Mean distance of the channels from their mean, over mean brightness. Grey views are below the first, views in colour
# above the second: 511 photographs of 86 captures have 0.010 to 0.45.
LARGEST_GREY, LEAST_COLOUR = 0.003, 0.009
_GRID = 8  # sample points per image side
_NEIGHBOURS = 2  # with whose photographs each view is compared


def check_input(
    views: Views, effort: str | OptimisationConfig = "default", guides: Views | None = None
) -> tuple[str, ...]:
    """Return one sentence per property of the views that reduces quality, such as too little parallax.

    effort, guides: as for `encode`. The result is empty if nothing is wrong. Raises InputError for an unknown effort.
    """
    return (
        *_warnings_about_cameras(views, guides),
        *_warnings_about_images(views),
        *_warnings_about_bounds(views, guides),
        *_warnings_about_poses(views, guides),
        *_warnings_about_size(views, config_of_effort(effort)),
    )


def _warnings_about_size(views: Views, config: OptimisationConfig) -> list[str]:
    height, width = grid_size(*views.image_size)
    num_pixels = len(views.images) * height * width
    if config.num_steps == 0 or num_pixels <= config.max_pixels:
        return []
    return [
        f"the views have {num_pixels:,} pixels in all, more than the {config.max_pixels:,} up to which latents are "
        "optimised, so the file is larger at equal quality; give fewer or smaller views."
    ]


def _warnings_about_cameras(views: Views, guides: Views | None) -> list[str]:
    cameras = views.cameras if guides is None else views.cameras.joined(guides.cameras)
    warnings = []
    ratio = float(cameras.far / cameras.near)
    if ratio > LARGEST_DEPTH_RATIO:
        warnings.append(
            f"far is {ratio:.0f} times near, so depth will be coarse; give tighter bounds by `near` and `far`."
        )
    (height, width), focal = views.image_size, views.cameras.intrinsics
    stretch = focal[:, 0, 0] * width / (focal[:, 1, 1] * height)
    if (ratio := float(torch.maximum(stretch, 1.0 / stretch).max())) > LARGEST_PIXEL_RATIO:
        warnings.append(
            f"the pixels are {ratio:.1f} times as long as wide or the reverse, by the focal lengths, so detail is lost "
            "along one side; correct `fl_x` and `fl_y`, or choose a `size` of the photographs' own shape."
        )
    if cameras.num_views == 1:
        return [
            *warnings,
            "one view has no parallax, so its depth is unreliable; add a view from another position.",
        ]
    depth = (cameras.near * cameras.far).sqrt()
    points = camera_to_world_points(cameras, depth * pixel_rays(cameras, _GRID, _GRID)).flatten(1, 2)  # samples
    overlap = _largest_overlap(points, cameras, views.ignored)
    alone = [
        f"{name} ({100 * share:.0f}%)"
        for name, share in zip(views.names, overlap.tolist(), strict=False)  # not of guides
        if share < LEAST_OVERLAP
    ]
    if alone:
        warnings.append(
            f"by their cameras, these views hardly overlap with any other: {', '.join(alone)}; choose others."
        )
    if _largest_parallax(points, cameras) < LEAST_PARALLAX_DEGREES:
        warnings.append("the cameras are almost at one position, so depth is unreliable; choose views farther apart.")
    return warnings


def _warnings_about_images(views: Views) -> list[str]:
    """Detect dark or bright views, and those of another kind than the rest: grey or transparent ones."""
    warnings = []
    if not DARKEST <= float(views.images.mean()) <= BRIGHTEST:
        warnings.append("the views are almost black or white; expose them so that surfaces can be distinguished.")
    grey = views.images.mean(dim=1, keepdim=True)
    brightness = grey.mean(dim=(1, 2, 3)).clamp_min(DARKEST)
    colourfulness = (views.images - grey).abs().mean(dim=(1, 2, 3)) / brightness
    if grey_views := _names(views.names, colourfulness < LARGEST_GREY, colourfulness > LEAST_COLOUR):
        warnings.append(
            f"{grey_views} without colours, the other views are coloured; give all views in colour, or none."
        )
    if views.alpha is not None:
        transparency = 1.0 - views.alpha.mean(dim=(1, 2))
        if cut_outs := _names(views.names, transparency > 0.0, transparency == 0.0):
            warnings.append(
                f"{cut_outs} transparent in part, the other views are opaque; cut out the object in all views, or give "
                "all without transparency."
            )
    return warnings


def _names(names: tuple[str, ...], is_odd: Bool[Tensor, " view"], is_usual: Bool[Tensor, " view"]) -> str:
    """Return "NAME is" or "NAME, NAME are" of the odd views; empty if there are none, or none is usual."""
    odd = [name for name, found in zip(names, is_odd.tolist(), strict=True) if found]
    if not odd or not bool(is_usual.any()):
        return ""
    return f"{', '.join(odd)} {'is' if len(odd) == 1 else 'are'}"


def _warnings_about_poses(views: Views, guides: Views | None) -> list[str]:
    """Compare cameras with points that look alike. A view is named if it fits none of its neighbours, guides included.

    A pair that does not fit, of views which both fit others, says nothing: patterns can repeat.
    """
    count, used = len(views.images), views if guides is None else joined([views, guides])
    fits = _fits_of_neighbours(used, count)
    right = [pair for pair, fit in fits.items() if fit.is_right]
    if sum(fit.has_reversed_axes for fit in fits.values()) > len(right):
        return [
            "the views agree much better with y and z axes reversed in all cameras; check whether the camera file uses "
            "OpenCV axes instead of OpenGL axes, or the reverse."
        ]
    in_place, warnings = {view for pair in right for view in pair}, []
    turned = {pair: fit for pair, fit in fits.items() if fit.is_turned and not in_place.issuperset(pair)}
    while turned:
        votes = Counter(view for pair in turned for view in pair if view not in in_place)
        suspect = max(votes, key=lambda view: (votes[view], view < count))
        of_suspect = {pair: fit for pair, fit in turned.items() if suspect in pair}
        pair, fit = max(of_suspect.items(), key=lambda item: item[1].count)
        is_undecided = votes[pair[0]] == votes[pair[1]]
        if suspect < count:
            named = pair if is_undecided else (suspect,)
            warnings.append(_warning_about_turn([used.names[view] for view in named], fit))
        turned = {pair: fit for pair, fit in turned.items() if pair not in of_suspect}
    return warnings


def _warning_about_turn(names: list[str], fit: Fit) -> str:
    """names: of one view that does not fit those beside it, or of two of which one is wrong."""
    what = f"much better with a camera turned by about {fit.degrees:.0f} degrees, so new views will be poor; check"
    if len(names) == 1:
        return f"{names[0]} fits the photographs beside it {what} its pose, or leave it out by `views`."
    return (
        f"{' and '.join(names)} fit each other {what} their poses, or leave the cameras out so that they are estimated."
    )


def _fits_of_neighbours(views: Views, count: int) -> dict[tuple[int, int], Fit]:
    """Return the fit of each of the first `count` views with the _NEIGHBOURS nearest views that look the same way."""
    pairs = neighbour_pairs(views.cameras, count, _NEIGHBOURS)
    ignored = views.ignored if views.ignored is not None else [None] * len(views.images)
    corners = {view: find_corners(views.images[view], ignored[view]) for view in sorted({v for p in pairs for v in p})}
    return {
        (first, second): fit_of(*match_corners(corners[first], corners[second]), views.cameras.select([first, second]))
        for first, second in pairs
    }


def _warnings_about_bounds(views: Views, guides: Views | None) -> list[str]:
    near, far = float(views.cameras.near), float(views.cameras.far)
    bounds = believable_bounds(views, guides)
    if bounds is None or (bounds[1] == far and near * MOST_AHEAD > bounds[0]):
        return []
    return [
        f"near and far are {near:.3g} and {far:.3g}, but matching finds the scene between {bounds[0]:.3g} and "
        f"{bounds[1]:.3g}, so depth will be wrong or coarse; give `near` and `far` in the unit of the camera "
        "positions, or leave both out."
    ]


def _largest_overlap(
    points: Float[Tensor, "view n 3"], cameras: Cameras, ignored: Bool[Tensor, "some height width"] | None
) -> Float[Tensor, " view"]:
    """Return, for each view, the fraction of its points that project into the image of the best other view.

    ignored: pixels of the first views, whose points do not count.
    """
    kept = torch.ones(points.shape[:2])
    if ignored is not None:
        kept[: len(ignored)] -= F.interpolate(ignored[:, None].float(), (_GRID, _GRID), mode="area").flatten(1)
    is_visible = cameras.project(points).is_visible  # [camera view n]
    share = ((is_visible * kept).sum(dim=-1) / kept.sum(dim=-1).clamp_min(1e-6)).T.clone()
    share.fill_diagonal_(0.0)
    return share.amax(dim=1)


def _largest_parallax(points: Float[Tensor, "view n 3"], cameras: Cameras) -> float:
    """Return the parallax in degrees: the angle between the rays of two views to a point.

    Median over the points of a view, maximum over pairs of views.
    """
    sight = points[:, None] - cameras.extrinsics[None, :, None, :3, 3]
    sight = sight / sight.norm(dim=-1, keepdim=True).clamp_min(1e-20)
    own = sight.diagonal(dim1=0, dim2=1).permute(2, 0, 1)[:, None]
    angle = 2.0 * torch.asin(((sight - own).norm(dim=-1) / 2.0).clamp(max=1.0))  # for small angles better than acos
    return float(torch.rad2deg(angle).median(dim=-1).values.max())
