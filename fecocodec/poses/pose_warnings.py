"""Warnings about estimated cameras that may be wrong."""

from fecocodec.poses.estimate_choice import LEAST_SHARE
from fecocodec.poses.estimated_cameras import Ambiguity, ImageGroup, Reconstruction

# Limits of a warning, chosen on training scenes (docs/inputs.md): change of the focal length, and differences of a
# second estimate in degrees.
_FOCAL_CHANGE, _ROTATION_DIFFERENCE, _DIRECTION_DIFFERENCE = 1.5, 1.5, 5.0
# Two photographs: ratio of focal lengths that explain the matches equally well, and degrees to another direction.
_FOCAL_SPAN, _OTHER_DIRECTION = 1.7, 15.0


def reliability_warnings(found: Reconstruction, groups: list[ImageGroup], focal_px: float) -> list[str]:
    """Return a warning if the cameras may be wrong, else nothing; their reprojection error is small in any case.

    focal_px: of the first camera, in pixels of its photograph, whose copy may be smaller.
    """
    first = found.cameras[0]
    group = next(group for group in groups if first.name in group.names)
    change, is_fixed = first.lens.fx / group.focal_px, group.is_fixed
    reasons = [] if found.ambiguity is None else _ambiguities(found.ambiguity, focal_px)
    is_confirmed = not is_fixed and is_agreement(found.difference)
    if not 1 / _FOCAL_CHANGE < change < _FOCAL_CHANGE and not is_confirmed:
        reasons.append(f"the estimated focal length is {change:.2f} times the initial one")
    if found.ambiguity is None:
        reasons += _differences(found.difference, is_fixed=is_fixed)
        if found.explained < LEAST_SHARE:
            reasons.append(f"they contradict {1 - found.explained:.0%} of the matches between two parts of them")
    if not reasons:
        return []
    remedy = (
        "add photographs between these, so that more of each is seen in three or more"
        if found.ambiguity is None
        else "take a third and a fourth photograph from other positions"
    )
    if not is_fixed:
        remedy += ", keep the EXIF data with the focal length"
    return [f"the cameras may be wrong: {' and '.join(reasons)}; {remedy}, or give known cameras."]


def is_agreement(difference: tuple[float, float] | None) -> bool:
    """Return whether two estimates are the same cameras. difference: of rotations and directions in degrees."""
    return difference is not None and difference[0] <= _ROTATION_DIFFERENCE and difference[1] <= _DIRECTION_DIFFERENCE


def _ambiguities(ambiguity: Ambiguity, focal_px: float) -> list[str]:
    """Return what the matches of two photographs leave open."""
    reasons = []
    low, high = ambiguity.zooms
    if high / low > _FOCAL_SPAN:
        reasons.append(
            f"two photographs do not determine their focal length here ({low * focal_px:.0f} to {high * focal_px:.0f} "
            "pixels explain the matches equally well)"
        )
    if ambiguity.direction > _OTHER_DIRECTION:
        reasons.append(
            f"the matches of two photographs fit another direction from the first camera to the second nearly as well "
            f"({ambiguity.direction:.0f} degrees away)"
        )
    return reasons


def _differences(difference: tuple[float, float] | None, *, is_fixed: bool) -> list[str]:
    """Return how a second estimate contradicts the first. is_fixed: whether the focal length of both is given."""
    second = "a second estimate from " + ("another initial pair" if is_fixed else "another initial focal length")
    if difference is None:
        return [f"{second} does not find all of them"]
    if is_agreement(difference):
        return []
    return [
        f"{second} differs by up to {difference[0]:.1f} degrees in rotation and {difference[1]:.0f} degrees in "
        "direction"
    ]
