"""Write decoded Gaussians and cameras in the requested frame and formats."""

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from .output import write_stdout
from .paths import STDOUT

if TYPE_CHECKING:
    from fecocodec import Decoded
    from fecocodec.runtime.decode import DecodedScene

Frame = Literal["input", "first-camera"]


def require_page(suffix: str) -> None:
    """Raise OutputError for `.html` if the viewer's page was not built, so that nothing is decoded in vain."""
    if suffix.lower() == ".html":
        from fecocodec.splat_files.html_page import scene_page

        scene_page()


def write_scene(
    decoded: "Decoded | DecodedScene",
    output: Path,
    cameras_file: Path | None,
    *,
    frame: Frame,
    spz_version: Literal[3, 4],
    overwrite: bool,
) -> None:
    """Write the Gaussians to `output`, and the cameras to `cameras_file` if it is given. Raises OutputError.

    If the cameras cannot be written, the Gaussians are not either.
    """
    from fecocodec.atomic import write_atomically
    from fecocodec.splat_files.camera_json import write_camera_json
    from fecocodec.splat_files.gaussian_arrays import camera_arrays, gaussian_arrays
    from fecocodec.splat_files.gaussian_files import gaussian_bytes, in_frame_of_first_camera

    gaussians = gaussian_arrays(decoded.gaussians, "standard output" if output == STDOUT else str(output))
    cameras = camera_arrays(decoded.cameras, decoded.image_size)
    if frame == "first-camera":
        gaussians, cameras = in_frame_of_first_camera(gaussians, cameras)
    data = gaussian_bytes(Path("standard output") if output == STDOUT else output, gaussians, cameras, spz_version)
    with nullcontext() if output == STDOUT else write_atomically(output, overwrite=overwrite) as temporary:
        if temporary is not None:
            temporary.write_bytes(data)
        if cameras_file is not None:
            names = [f"{view:02d}.png" for view in range(len(cameras.extrinsics))]  # as `render` names its images
            write_camera_json(cameras_file, cameras, names, overwrite=overwrite)
    if output == STDOUT:
        write_stdout(data)
