"""Refuse cameras that were estimated from photographs and cannot be right."""

from fecocodec.errors import InputError
from fecocodec.photographs.lens import undistorted
from fecocodec.poses.estimated_cameras import EstimatedCamera, Reconstruction
from fecocodec.poses.pose_estimation import LEAST_ANGLE, LEAST_MATCHES

_REMEDY = "take photographs that overlap by more than half, from different positions, of a scene with texture"


def require_usable(name: str, found: Reconstruction, *, is_focal_given: bool = False) -> None:
    """Raise InputError if the reconstruction is not usable. name: of the input."""
    if found.is_turned:
        raise InputError(
            f"{name}: the photographs seem to be taken from one position (a turn of the camera explains their "
            "matches), so depth is unknown; move the camera sideways between photographs."
        )
    if len(found.cameras) < 2:
        raise InputError(f"{name}: no camera poses can be estimated ({obstacle(found)}); {_REMEDY}.")
    if found.angle < LEAST_ANGLE:
        raise InputError(
            f"{name}: the photographs seem to be taken from one position (median angle between rays "
            f"{found.angle:.2f} degrees), so depth is unknown; move the camera sideways between photographs."
        )
    if sum(map(_has_inverse, found.cameras)) < 2:
        focal = "" if is_focal_given else ", give their focal length by `focal_px`"
        raise InputError(
            f"{name}: the cameras that were estimated from the photographs are wrong (their lens distortion has no "
            f"inverse inside the image); {_REMEDY}{focal}, or give known cameras."
        )


def _has_inverse(camera: EstimatedCamera) -> bool:
    """Return whether the estimated lens can be undistorted."""
    try:
        undistorted(camera.lens, camera.name)
    except InputError:
        return False
    return True


def obstacle(found: Reconstruction) -> str:
    """Return why no pair of photographs can be reconstructed."""
    if not found.matches:
        return "no two photographs have matches"
    most, (first, second) = max((count, pair) for pair, count in found.matches.items())
    if most < LEAST_MATCHES:
        return f"{first} and {second} have the most matches, {most}, but {LEAST_MATCHES} are needed"
    return "the matches do not determine camera positions, as if the camera only turned"
