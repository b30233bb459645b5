"""Benchmark the CPU rasteriser, including projection and spherical harmonics: `python benchmarks/bench_rasterizer.py`.

The synthetic scene resembles a decoded pair of 256x256 views: 32,768 Gaussians with a standard deviation of about one
pixel, rendered at 256x256. Times are medians.
"""

from statistics import median
from time import perf_counter

import torch

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.rasterizer import render

SIZE = 256
NUM_GAUSSIANS = 2 * (SIZE // 2) ** 2
REPEATS = 25


def decoded_scene(scale_px: float, num_harmonics: int) -> tuple[Gaussians, Cameras]:
    """Return Gaussians uniformly distributed over the image at depths 1 to 5, and one camera.

    scale_px: median standard deviation of the Gaussians in pixels. num_harmonics: (SH degree + 1) squared.
    """
    generator = torch.Generator().manual_seed(0)
    uniform = torch.rand(NUM_GAUSSIANS, 3, generator=generator)
    depth = 1.0 + 4.0 * uniform[:, 2:]
    gaussians = Gaussians(
        means=torch.cat(((uniform[:, :2] - 0.5) * depth, depth), dim=-1),
        scales=torch.exp(0.5 * torch.randn(NUM_GAUSSIANS, 3, generator=generator)) * scale_px * depth / SIZE,
        rotations=torch.nn.functional.normalize(torch.randn(NUM_GAUSSIANS, 4, generator=generator), dim=-1),
        opacities=0.1 + 0.85 * torch.rand(NUM_GAUSSIANS, generator=generator),
        harmonics=0.3 * torch.randn(NUM_GAUSSIANS, num_harmonics, 3, generator=generator),
    )
    intrinsics = torch.tensor([[[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]]])
    return gaussians, Cameras(torch.eye(4)[None], intrinsics, torch.tensor(0.5), torch.tensor(100.0))


def measure(scale_px: float, num_harmonics: int) -> tuple[float, float]:
    """Return the median milliseconds of the forward pass and of the backward pass."""
    gaussians, cameras = decoded_scene(scale_px, num_harmonics)
    leaves = Gaussians(*(field.requires_grad_() for field in gaussians.fields()))
    gradient = torch.randn(1, 3, SIZE, SIZE, generator=torch.Generator().manual_seed(1))
    forward, backward = [], []
    for _ in range(REPEATS):
        begun = perf_counter()
        color = render(leaves, cameras, (SIZE, SIZE)).color
        rendered = perf_counter()
        torch.autograd.grad(color, leaves.fields(), gradient)
        forward.append(rendered - begun)
        backward.append(perf_counter() - rendered)
    return 1e3 * median(forward), 1e3 * median(backward)


def main() -> None:
    print(f"{NUM_GAUSSIANS} Gaussians, {SIZE}x{SIZE} pixels, medians of {REPEATS}")
    print("threads  scale_px  sh_degree  forward_ms  backward_ms")
    for num_threads in (1, 2):
        torch.set_num_threads(num_threads)
        for scale_px in (1.0, 1.5):
            for degree in (0, 2, 3):
                forward, backward = measure(scale_px, (degree + 1) ** 2)
                print(f"{num_threads:7d}  {scale_px:8.1f}  {degree:9d}  {forward:10.1f}  {backward:11.1f}")


if __name__ == "__main__":
    main()
