"""A gate on the shipped weights, sender and receiver together: bytes, PSNR, depth and ST-LPIPS from decoded files.

Last bits change results on another processor or with other threads, and move the target views of one synthetic scene by
0.3 dB. So the bounds of the defaults are on the bundled scene and on the mean of eight small synthetic scenes. Two of
these have bounds of their own at sharpness -1.
`test_worse_weights_fail` (slow) perturbs the weights and asserts that the gate fails.
"""

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from functools import cache, partial
from pathlib import Path
from statistics import fmean
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from fecosplat_cli.command_line import command_line
from jaxtyping import Float
from PIL import Image
from torch import Tensor, nn

import fecocodec
from fecocodec.checkpoint import model_folder
from fecocodec.container import quantise_lambda
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.perceptual import st_lpips
from fecocodec.rendering.rasterizer import Rendering, render
from fecocodec.sender.codec import load_codec
from fecocodec.sender.encode import encode_with
from fecocodec.splatting.background import DEFAULT_BACKGROUND
from fecocodec.training.synthetic.scenes import SyntheticScenes
from fecocodec.training.synthetic.textures import pattern_textures

LMBDA = 1e-3

EXAMPLE = Path(__file__).resolve().parent.parent / "examples" / "motorcycle"
SYNTHETIC_SEEDS = [20_261_124_000 + number for number in range(1, 9)]  # generators of training have small seeds
SYNTHETIC_SIZE = (128, 128)  # height, width in pixels
NUM_CONTEXT, NUM_TARGET = 2, 2
NUM_PATTERNS = 100
NOISE = 0.08  # relative, of the weights in `test_worse_weights_fail`

Encode = Callable[[Views], bytes]
Decode = Callable[[bytes, bool], fecocodec.Gaussians]  # (stream, whether to add the background layer)


@dataclass(frozen=True)
class Scores:
    """Bytes of a file, PSNR of context and target views in dB, relative depth error, and ST-LPIPS of target views.

    Without target views, ST-LPIPS is that of the context views, and target is infinite.
    """

    num_bytes: float
    context: float
    target: float
    depth_error: float
    st_lpips: float

    def failures(self, bounds: "Scores") -> set[str]:
        """Return the names of the bounds that these scores violate."""
        is_within = {
            "bytes": self.num_bytes <= bounds.num_bytes,
            "context": self.context >= bounds.context,
            "target": self.target >= bounds.target,
            "depth": self.depth_error <= bounds.depth_error,
            "ST-LPIPS": self.st_lpips <= bounds.st_lpips,
        }
        return {bound for bound, is_kept in is_within.items() if not is_kept}


# Measured with compact-6 (`python -m tests.test_shipped_weights`), with AVX-512 / AVX2, which codes no detail at this
# lambda. Bundled scene: 16024 / 16044 bytes, context 24.52 / 24.53 dB, depth 0.0131 / 0.0133, ST-LPIPS 0.162 / 0.161.
# Mean of the synthetic scenes: 2323 / 2323 bytes, context 29.37 / 29.39 dB, target 27.23 / 27.28 dB, depth 0.0814 /
# 0.0809, ST-LPIPS 0.201 / 0.199. Move the bounds with the weights, never to a worse trade.
MOTORCYCLE = Scores(16_230, 24.29, -math.inf, 0.0142, 0.168)
SYNTHETIC = Scores(2_360, 29.22, 27.10, 0.0855, 0.206)  # the context views lose 0.15 dB on an AMD processor
# Two synthetic scenes at sharpness -1: 2604 / 2604 bytes, context 26.62 / 26.58 dB, target 21.46 / 21.46 dB, depth
# 0.0431 / 0.0440; 2071 / 2071 bytes, 30.19 / 30.19 dB, 29.80 / 29.80 dB, 0.0129 / 0.0129.
SMOOTHEST = (Scores(2_680, 26.45, 21.20, 0.0470, math.inf), Scores(2_130, 30.05, 29.65, 0.0140, math.inf))


@dataclass(frozen=True)
class Scene:
    """Two context views, then target views (perhaps none), with exact depth of the first views; 0 where unknown."""

    views: Views
    depth: Float[Tensor, "view height width"]


@dataclass(frozen=True)
class Measured:
    """What the file of a scene takes and gives.

    surfaces: rendering without the background layer, whose far Gaussians shine through surfaces a little.
    """

    scene: Scene
    num_bytes: int
    rendering: Rendering
    surfaces: Rendering

    @property
    def scores(self) -> Scores:
        pictures, photographs = self.rendering.color.clamp(0, 1), self.scene.views.images
        context, target = psnr(pictures, photographs).tensor_split([NUM_CONTEXT])
        first = NUM_CONTEXT if len(target) else 0
        return Scores(
            self.num_bytes,
            float(context.mean()),
            float(target.mean()) if len(target) else math.inf,
            self.depth_error,
            float(st_lpips(pictures[first:], photographs[first:]).mean()),
        )

    @property
    def depth_error(self) -> float:
        """Median of |depth - exact| / exact where something is drawn and the exact depth is known."""
        exact = self.scene.depth
        depth, alpha = self.surfaces.depth[: len(exact)], self.surfaces.alpha[: len(exact)]
        is_known = (exact > 0) & (alpha > 0.5)
        return float(((depth - exact).abs() / exact)[is_known].median())


def bundled_scene() -> Scene:
    views = fecocodec.read_views(EXAMPLE)
    millimetres = np.asarray(Image.open(EXAMPLE / "left_depth.png")).astype(np.float32)
    return Scene(views, torch.from_numpy(millimetres / 1000)[None])


@cache
def synthetic_scenes() -> SyntheticScenes:
    return SyntheticScenes(pattern_textures(NUM_PATTERNS))


@cache
def synthetic_scene(seed: int) -> Scene:
    generator = torch.Generator().manual_seed(seed)
    sample = synthetic_scenes().sample(generator, num_context=NUM_CONTEXT, num_target=NUM_TARGET, size=SYNTHETIC_SIZE)
    assert sample.depth is not None
    return Scene(sample.views, sample.depth)


def decoded_by_command(data: bytes, has_background: bool) -> fecocodec.Gaussians:
    """Gaussians of the PLY that `fecosplat decode --no-merge` writes, with or without the background layer.

    Merging is judged by tests of its own; these bounds are those of the weights.
    """
    with TemporaryDirectory() as folder:
        stream, ply = Path(folder) / "scene.fcs", Path(folder) / "scene.ply"
        stream.write_bytes(data)
        layer = "--background-layer" if has_background else "--no-background-layer"
        result = CliRunner().invoke(command_line, ["decode", str(stream), "-o", str(ply), "--no-merge", layer])
        assert result.exit_code == 0, result.output
        return fecocodec.read_ply(ply)


def measure(scene: Scene, encode: Encode, decode: Decode) -> Measured:
    """Encode the context views of a scene, decode the file, and render all views."""
    data = encode(scene.views.select(list(range(NUM_CONTEXT))))
    with torch.no_grad():
        renderings = (
            render(decode(data, has_background), scene.views.cameras, scene.views.image_size)
            for has_background in (True, False)
        )
        return Measured(scene, len(data), *renderings)


def mean_scores(scores: Sequence[Scores]) -> Scores:
    return Scores(*map(fmean, zip(*map(astuple, scores), strict=True)))


@cache
def shipped(seed: int | None, sharpness: float = 0.0) -> Scores:
    """Measure the shipped weights on a synthetic scene or on the bundled one, with `encode` and `fecosplat decode`."""
    scene = bundled_scene() if seed is None else synthetic_scene(seed)
    return measure(scene, partial(fecocodec.encode, lmbda=LMBDA, sharpness=sharpness), decoded_by_command).scores


@pytest.mark.timeout(600)
def test_the_bundled_scene_keeps_all_bounds() -> None:
    assert shipped(None).failures(MOTORCYCLE) == set()


@pytest.mark.timeout(600)
def test_synthetic_scenes_keep_all_bounds() -> None:
    assert mean_scores([shipped(seed) for seed in SYNTHETIC_SEEDS]).failures(SYNTHETIC) == set()


@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", range(len(SMOOTHEST)))
def test_single_synthetic_scenes_keep_all_bounds_at_the_smoothest(number: int) -> None:
    assert shipped(SYNTHETIC_SEEDS[number], sharpness=-1.0).failures(SMOOTHEST[number]) == set()


@pytest.mark.timeout(600)
def test_sharpness_makes_pictures_sharper() -> None:
    """By ST-LPIPS of the target views of a synthetic scene, for a file that is a little larger."""
    seed = SYNTHETIC_SEEDS[1]
    smoothest, default, sharpest = shipped(seed, sharpness=-1.0), shipped(seed), shipped(seed, sharpness=1.0)
    assert sharpest.st_lpips < 0.97 * default.st_lpips < 0.97 * 0.98 * smoothest.st_lpips
    assert smoothest.num_bytes < default.num_bytes < sharpest.num_bytes < 1.3 * smoothest.num_bytes


def perturb(network: nn.Module, noise: float) -> None:
    """Multiply every weight by 1 + noise * a standard normal number, in place."""
    generator = torch.Generator().manual_seed(0)
    for parameter in network.parameters():
        parameter.mul_(1 + noise * torch.randn(parameter.shape, generator=generator))


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("end", ["sender", "receiver"])
@torch.no_grad()
def test_worse_weights_fail(end: str) -> None:
    codec = copy.deepcopy(load_codec(model_folder(None), "cpu"))
    perturb(codec.sender if end == "sender" else codec.receiver, NOISE)

    def decoded(data: bytes, has_background: bool) -> fecocodec.Gaussians:
        background = DEFAULT_BACKGROUND if has_background else None
        return decode_with(codec.receiver, data, background=background, merging=None).gaussians

    encode = partial(encode_with, codec, lambda_q=quantise_lambda(LMBDA))
    measured = [measure(synthetic_scene(seed), encode, decoded).scores for seed in SYNTHETIC_SEEDS]
    assert mean_scores(measured).failures(SYNTHETIC) & {"bytes", "target"}


if __name__ == "__main__":
    print("bundled scene:", shipped(None))
    for seed in SYNTHETIC_SEEDS:
        print(f"synthetic scene {seed}:", shipped(seed))
    print("mean of synthetic scenes:", mean_scores([shipped(seed) for seed in SYNTHETIC_SEEDS]))
