"""The cameras that `fecosplat render` renders at: those of the file, of --cameras, or of a path near them."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from fecocodec.captures.view_selection import Selection
from fecocodec.container import read_header
from fecocodec.errors import error_context

from .output import in_options, say

if TYPE_CHECKING:
    from fecocodec import Cameras, Decoded, Gaussians
    from fecocodec.captures.render_cameras import RenderCameras

PATH_NAMES = ("spiral", "orbit", "between")
DEFAULT_FRAMES, DEFAULT_FPS = 120, 30.0


def read_given_cameras(path: Path, selection: Selection | None, size: tuple[int, int] | None) -> "RenderCameras":
    """Read the cameras of --cameras."""
    from fecocodec.captures.render_cameras import read_render_cameras

    cameras = read_render_cameras(path, views=selection, size=size)
    for note in cameras.notes:
        say(f"note: {in_options(note)}")
    return cameras


def names_of(given: "RenderCameras | None", scene: Path, data: bytes, num_frames: int | None) -> tuple[str, ...]:
    """Return one name per rendering: that of its photograph, or its number. num_frames: of a path, None without one."""
    if num_frames is None and given is not None:
        return given.names
    if num_frames is None:
        with error_context(scene):
            num_frames = read_header(data).header.num_views
    digits = max(2, len(str(num_frames - 1)))
    return tuple(f"{number:0{digits}d}" for number in range(num_frames))


def cameras_and_size(
    given: "RenderCameras | None", decoded: "Decoded | None", gaussians: "Gaussians", size: tuple[int, int] | None
) -> "tuple[Cameras, tuple[int, int]]":
    """Return the cameras before a path is laid near them, and (height, width) in pixels.

    size: that of --size, (height, width). Depth bounds are those of the decoded file, else of the camera file, else of
    the visible Gaussians.
    """
    from fecocodec import Cameras

    coded = None if decoded is None else Cameras.of(decoded.cameras)
    if given is None:
        assert decoded is not None and coded is not None  # a .ply file needs --cameras
        if size is None:
            return coded, decoded.image_size

        from fecocodec.captures.render_cameras import resized

        return resized(coded, decoded.image_size, size), size
    if coded is not None:
        return replace(given.cameras, near=coded.near, far=coded.far), given.image_size
    if given.has_depth_bounds:
        return given.cameras, given.image_size

    from fecocodec.geometry.depth_range import bounds_of_visible_points

    near, far = bounds_of_visible_points(gaussians.means.cpu(), given.cameras)
    bounds = {"near": given.cameras.near.new_tensor(near), "far": given.cameras.far.new_tensor(far)}
    return replace(given.cameras, **bounds), given.image_size
