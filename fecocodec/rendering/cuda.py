"""Rendering on CUDA by gsplat, equal to the CPU renderer up to rounding."""

import math
import sys
from collections.abc import Callable
from contextlib import nullcontext, redirect_stdout
from typing import Any

import torch

from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.layers.memory_format import usable_device
from fecocodec.rendering.cpu import Rendering

BACKEND = "gsplat.cuda._backend"
REMEDY = (
    "install the packages that it needs, and the CUDA toolkit of PyTorch's version or gsplat's compiled wheel "
    "(https://docs.gsplat.studio/whl); or use the CPU by `device`."
)


def render_on_cuda(
    gaussians: Gaussians,
    cameras: Cameras,
    image_size: tuple[int, int],
    background: tuple[float, float, float],
    near: float,
) -> Rendering:
    """Render as `rasterizer.render` does. near: least depth of drawn means. Raises InputError without gsplat."""
    rasterization = gsplat_rasterization()
    height, width = image_size
    drawable = _finite(gaussians)
    cameras = cameras.to(drawable.means.device)
    backgrounds = drawable.means.new_tensor(background, dtype=torch.float32).repeat(cameras.num_views, 1)
    if drawable.count == 0:
        nothing = backgrounds.new_zeros(cameras.num_views, height, width)
        return Rendering(backgrounds[:, :, None, None].expand(-1, -1, height, width), nothing, nothing)
    means, scales, rotations, opacities, harmonics = (field.to(torch.float32) for field in drawable.fields())
    images, alpha, _ = rasterization(
        means=means,
        quats=rotations,
        scales=scales,
        opacities=opacities,
        colors=harmonics,
        viewmats=cameras.world_to_camera.to(torch.float32).contiguous(),
        Ks=cameras.intrinsics_px(height, width).to(torch.float32).contiguous(),
        width=width,
        height=height,
        near_plane=near,
        sh_degree=math.isqrt(harmonics.shape[-2]) - 1,
        packed=False,
        backgrounds=backgrounds,
        render_mode="RGB+ED",
    )
    return Rendering(images[..., :3].permute(0, 3, 1, 2), images[..., 3], alpha[..., 0])


def require_rendering_device(name: str) -> None:
    """Raise InputError if a device, or gsplat, which renders on CUDA devices, is missing."""
    usable_device(name)
    if name != "cpu":
        gsplat_rasterization()


def gsplat_rasterization() -> Callable[..., Any]:
    """Return gsplat's `rasterization`. Its first import compiles kernels, which takes minutes, unless it is compiled.

    Raises InputError if gsplat is not installed or cannot be loaded, for example because its kernels do not compile.
    """
    is_first = BACKEND not in sys.modules
    try:
        # Imported here, because most installations lack it. It reports what it compiles on stdout, which may be ours.
        with redirect_stdout(sys.stderr) if is_first else nullcontext():
            from gsplat import rasterization
            from gsplat.cuda._backend import _C
    except (ImportError, RuntimeError, OSError) as error:
        if isinstance(error, ImportError) and (error.name or "gsplat").split(".")[0] == "gsplat":
            raise InputError(
                "Gaussians on a CUDA device are rendered by gsplat, which is not installed; "
                "run `pip install gsplat`, or use the CPU by `device`."
            ) from error
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        raise InputError(f"gsplat, which renders on a CUDA device, cannot be loaded ({reason}); {REMEDY}") from error
    if _C is None:
        raise InputError(f"gsplat found no CUDA toolkit (nvcc) with which it could compile its kernels; {REMEDY}")
    function: Callable[..., Any] = rasterization
    return function


def _finite(gaussians: Gaussians) -> Gaussians:
    """Remove Gaussians with a value that is not finite, which gsplat would draw."""
    is_finite = torch.ones_like(gaussians.opacities, dtype=torch.bool)
    for field in gaussians.fields():
        is_finite &= field.detach().isfinite().reshape(gaussians.count, math.prod(field.shape[1:])).all(dim=-1)
    return gaussians.keep(is_finite)
