"""Render Gaussians through pinhole cameras."""

from collections.abc import Iterator

from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussian_arrays import GaussianArrays, SceneCameras, shape_problem
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.cpu import Rendering, render_on_cpu
from fecocodec.rendering.cuda import render_on_cuda

__all__ = ["Rendering", "render", "render_each"]

_NEAR_FRACTION = 0.1  # Gaussians closer than this fraction of the near bound are not drawn
_SH_SIZES = (1, 4, 9, 16)


def render(
    gaussians: Gaussians | GaussianArrays,
    cameras: Cameras | SceneCameras,
    image_size: tuple[int, int],
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Rendering:
    """Render the Gaussians of one scene at its cameras, on the device of the Gaussians.

    gaussians, cameras: without batch dimensions, in one world frame and unit of length; arrays are rendered on the CPU.
    image_size: (height, width) in pixels. background: sRGB. The result is differentiable once, in float32, with respect
    to all fields of the Gaussians; the cameras receive no gradient. Gaussians with values that are not finite are not
    drawn. On the CPU the result does not depend on the number of threads (that of torch). `projection` and
    `compositing` implement the rules of 3DGS.

    Raises InputError if shapes or the image size cannot be used, or if the device has no renderer.
    """
    gaussians, cameras = Gaussians.of(gaussians), Cameras.of(cameras)
    _check(gaussians, cameras, image_size)
    near = _NEAR_FRACTION * float(cameras.near)
    device = gaussians.means.device.type
    if device == "cuda":
        return render_on_cuda(gaussians, cameras, image_size, background, near)
    if device == "cpu":
        return render_on_cpu(gaussians, cameras, image_size, background, near)
    raise InputError(f"Gaussians on device '{device}' cannot be rendered; move them to 'cpu' or 'cuda'.")


def render_each(
    gaussians: Gaussians,
    cameras: Cameras,
    image_size: tuple[int, int],
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Iterator[Rendering]:
    """Yield the rendering of one camera after another, to need little memory. Arguments and errors as for `render`."""
    for view in range(cameras.num_views):
        yield render(gaussians, cameras.select([view]), image_size, background)


def _check(gaussians: Gaussians, cameras: Cameras, image_size: tuple[int, int]) -> None:
    if gaussians.means.ndim != 2 or cameras.extrinsics.ndim != 3:
        raise InputError(
            f"Rendering takes one scene, but means have shape {tuple(gaussians.means.shape)} and extrinsics "
            f"{tuple(cameras.extrinsics.shape)}; render the scenes of a batch one by one."
        )
    if problem := shape_problem(gaussians):
        raise InputError(problem)
    if gaussians.harmonics.shape[-2] not in _SH_SIZES:
        raise InputError(
            f"Gaussians carry {gaussians.harmonics.shape[-2]} harmonics a colour; use 1, 4, 9 or 16 (degree 0 to 3)."
        )
    if min(image_size) < 1:
        raise InputError(
            f"An image of height {image_size[0]} and width {image_size[1]} has no pixels; make both positive."
        )
    if not all(bool(field.isfinite().all()) for field in (cameras.extrinsics, cameras.intrinsics)):
        raise InputError("a camera holds a value that is not finite; correct its pose and intrinsics.")
    if not float(cameras.near) > 0.0:
        raise InputError(f"The near bound of the cameras is {float(cameras.near)}; it must be a positive depth.")
