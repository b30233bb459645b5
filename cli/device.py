"""Early checks that the device given by `--device` can be used."""

from fecocodec.layers.memory_format import usable_device
from fecocodec.rendering.cuda import gsplat_rasterization


def require_encoding_device(name: str, num_stages: int, effort: str) -> None:
    """Check a device on which views are encoded: feedback and optimisation of latents render on it.

    Raises InputError as `usable_device` or `require_rendering_device` does.
    """
    if num_stages == 1 and effort == "fast":
        usable_device(name)
    else:
        require_rendering_device(name)


def require_rendering_device(name: str) -> None:
    """Check a device on which Gaussians are rendered; rendering on CUDA needs gsplat.

    Raises InputError if the device, or gsplat for a CUDA device, is missing.
    """
    usable_device(name)
    if name != "cpu":
        gsplat_rasterization()
