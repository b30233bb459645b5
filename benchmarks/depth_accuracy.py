"""Measure the depth error of decoded Gaussians on synthetic scenes that are not used for training.

    python benchmarks/depth_accuracy.py MODEL_FOLDER [--textures FOLDER] [--scenes 40] [--lambdas 1e-2 1e-3 1e-4]

Each scene has two context and two target views of 256x256 pixels, generated with a separate seed. Depth is the expected
depth along the optical axis, rendered from the decoded Gaussians. Far Gaussians of the background layer shine through
surfaces a little; --no-background-layer measures the surfaces alone. The error is |depth - exact| / exact over covered
pixels (alpha > 1/2), reported separately for context views and target views. For comparison, the error of the best
constant depth of each scene is reported.
"""

import argparse
from pathlib import Path
from statistics import mean, median

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.container import quantise_lambda
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.encode import encode_with
from fecocodec.splatting.background import DEFAULT_BACKGROUND, BackgroundConfig
from fecocodec.training.samples import Sample
from fecocodec.training.synthetic.scenes import SyntheticScenes
from fecocodec.training.synthetic.textures import pattern_textures, textures_from_folder

SEED = 20_261_121_001  # differs from all seeds of training, which are small numbers
NUM_PATTERNS, NUM_CONTEXT, NUM_TARGET = 100, 2, 2
LEAST_ALPHA = 0.5


def relative_errors(depth: Float[Tensor, " pixel"], exact: Float[Tensor, " pixel"]) -> Float[Tensor, " pixel"]:
    """Return |depth - exact| / exact."""
    return (depth - exact).abs() / exact


def errors_of(codec: Codec, sample: Sample, lambda_q: int, background: BackgroundConfig | None) -> dict[str, float]:
    """Encode and decode one scene, and return its relative depth errors and the fraction of covered pixels."""
    assert sample.depth is not None
    context = sample.views.select(list(range(NUM_CONTEXT)))
    data = encode_with(codec, context, lambda_q)
    gaussians = decode_with(codec.receiver, data, background=background).gaussians
    with torch.no_grad():
        rendering = render(gaussians, sample.views.cameras, sample.views.image_size)
    is_covered = rendering.alpha > LEAST_ALPHA
    errors = [
        relative_errors(depth[covered], exact[covered])
        for depth, exact, covered in zip(rendering.depth, sample.depth, is_covered, strict=True)
    ]
    seen, new = torch.cat(errors[:NUM_CONTEXT]), torch.cat(errors[NUM_CONTEXT:])
    return {
        "context": float(seen.mean()),
        "target": float(new.mean()),
        "target median": float(new.median()),
        "constant": constant_error(sample.depth[:NUM_CONTEXT].flatten()),
        "covered": float(is_covered.float().mean()),
    }


def constant_error(exact: Float[Tensor, " pixel"]) -> float:
    """Return the smallest mean relative error of a constant depth, chosen among quantiles of the exact depth."""
    candidates = exact.quantile(torch.linspace(0.05, 0.95, 19))
    return min(float(relative_errors(candidate.expand_as(exact), exact).mean()) for candidate in candidates)


def main() -> None:
    """Print one line per lambda: mean over scenes of each quantity, and the median over scenes of the target error."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="folder of the weights")
    parser.add_argument("--textures", type=Path, help="folder of images for textures, besides the built-in patterns")
    parser.add_argument("--scenes", type=int, default=40, help="number of scenes  [default: 40]")
    parser.add_argument("--size", type=int, default=256, help="image side in pixels  [default: 256]")
    parser.add_argument("--no-background-layer", action="store_true", help="decode without the background layer")
    parser.add_argument("--lambdas", type=float, nargs="+", default=[1e-2, 1e-3, 1e-4])
    arguments = parser.parse_args()
    textures = pattern_textures(NUM_PATTERNS)
    if arguments.textures is not None:
        textures += textures_from_folder(arguments.textures)
    codec, world = load_codec(arguments.model, "cpu"), SyntheticScenes(textures)
    size = (arguments.size, arguments.size)
    print("lambda\tcontext\ttarget\tmedian scene, target\tmedian pixel, target\tbest constant\tcovered")
    for lmbda in arguments.lambdas:
        generator = torch.Generator().manual_seed(SEED)
        rows = [
            errors_of(
                codec,
                world.sample(generator, num_context=NUM_CONTEXT, num_target=NUM_TARGET, size=size),
                quantise_lambda(lmbda),
                None if arguments.no_background_layer else DEFAULT_BACKGROUND,
            )
            for _ in range(arguments.scenes)
        ]
        found = {name: mean(row[name] for row in rows) for name in rows[0]}
        print(
            f"{lmbda:g}\t{found['context']:.3f}\t{found['target']:.3f}\t{median(row['target'] for row in rows):.3f}\t"
            f"{found['target median']:.3f}\t{found['constant']:.3f}\t{found['covered']:.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
