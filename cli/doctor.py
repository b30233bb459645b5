"""`fecosplat doctor`: versions, optional extras, compiled kernels, and the speed of this machine."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from time import perf_counter

import click

from fecocodec import __version__
from fecocodec.errors import installation

from .options import json_option, threads_option
from .output import print_fields, print_json

LIBRARIES = ("torch", "numpy", "scipy", "numba", "constriction", "zstandard", "Pillow", "OpenEXR")
EXTRAS = {
    "cuda": "gsplat",
    "cluster": "distributed",
    "poses": "pycolmap",
    "video": "av",
    "heic": "pillow-heif",
    "png16": "imagecodecs",
    "eval": "flip-evaluator",
}
NUM_GAUSSIANS, SIDE_PX = 20_000, 256
DRAWN = f"{NUM_GAUSSIANS:,} Gaussians at {SIDE_PX}x{SIDE_PX}"
NOT_MEASURED = "not measured: torch is not installed; the receiver alone works without it"


@click.command(
    "doctor",
    short_help="Show versions, optional extras and the speed of this machine.",
    epilog="""\b
Examples:
  fecosplat doctor
  fecosplat doctor --threads 1
  fecosplat doctor --json""",
)
@threads_option
@json_option
def command(as_json: bool) -> None:
    """Show versions, optional extras, whether kernels are compiled, and how fast this machine renders.

    Kernels are compiled on first use; running this command once after installation compiles those of rendering.
    """
    has_torch = installed("torch") is not None  # the receiver alone does without
    first, later = rendering_seconds() if has_torch else (None, None)
    fields = {
        "fecosplat": __version__,
        "python": platform.python_version(),
        "processor": f"{platform.machine()}, {os.cpu_count()} threads",
        "cuda": cuda_device() if has_torch else NOT_MEASURED,
        **{name.lower(): installed(name) or "missing" for name in LIBRARIES},
        **{f"extra {extra}": installed(name) or f"missing: {installation(extra)}" for extra, name in EXTRAS.items()},
        "kernels": NOT_MEASURED if first is None else f"ready, first use took {first:.2f} s",
        "speed": NOT_MEASURED if later is None else f"{DRAWN} in {1000 * later:.0f} ms",
    }
    if as_json:
        seconds = {"first_rendering_seconds": first, "rendering_seconds": later}
        print_json({**fields, **{name: value and round(value, 4) for name, value in seconds.items()}})
    else:
        print_fields(list(fields.items()))


def installed(distribution: str) -> str | None:
    """Return the version of an installed distribution."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None


def cuda_device() -> str:
    """Return the name of the first CUDA device."""
    import torch

    return torch.cuda.get_device_name(0) if torch.cuda.is_available() else "none"


def rendering_seconds() -> tuple[float, float]:
    """Return the time of the first and of the second rendering of random Gaussians on the CPU."""
    import torch

    from fecocodec import Cameras, Gaussians, render

    generator = torch.Generator().manual_seed(0)
    means = torch.rand(NUM_GAUSSIANS, 3, generator=generator) * 2 - 1 + torch.tensor([0.0, 0.0, 3.0])
    rotations = torch.nn.functional.normalize(torch.randn(NUM_GAUSSIANS, 4, generator=generator), dim=-1)
    gaussians = Gaussians(
        means,
        torch.full((NUM_GAUSSIANS, 3), 0.02),
        rotations,
        torch.full((NUM_GAUSSIANS,), 0.5),
        torch.rand(NUM_GAUSSIANS, 1, 3, generator=generator),
    )
    intrinsics = torch.tensor([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    cameras = Cameras(torch.eye(4)[None], intrinsics[None], torch.tensor(1.0), torch.tensor(10.0))
    seconds = []
    for _ in range(2):
        start = perf_counter()
        render(gaussians, cameras, (SIDE_PX, SIDE_PX))
        seconds.append(perf_counter() - start)
    return seconds[0], seconds[1]
