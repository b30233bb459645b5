"""Measure objects that are cut out of procedural scenes, on white, grey and black.

    python benchmarks/cut_outs.py MODEL_FOLDER [--textures FOLDER] [--scenes 8] [--views 2] [--lmbda 1e-3]

Each scene has two target views; all views have 256x256 pixels and are generated with a separate seed. Opaque is what
lies near the median point of the context views: a ball with 40% of their pixels. PSNR is that of whole images.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from statistics import mean

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from fecocodec.container import quantise_lambda
from fecocodec.geometry.cameras import camera_to_world_points, pixel_rays
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.encode import encode_with
from fecocodec.training.procedural.scenes import ProceduralWorld
from fecocodec.training.procedural.textures import pattern_textures, textures_from_folder
from fecocodec.training.samples import Sample

SEED = 20_261_126_001  # differs from all seeds of training, which are small numbers
NUM_PATTERNS, NUM_TARGET = 100, 2
SHARE_WITHIN = 0.4  # of the context views' pixels
LEVELS = {"white": 1.0, "grey": 0.5, "black": 0.0}


def opacity_of(sample: Sample) -> Float[Tensor, "view height width"]:
    """Return the opacity of each pixel, in [0, 1]; averaged over 3x3 pixels, for soft silhouettes."""
    assert sample.depth is not None
    cameras, size = sample.views.cameras, sample.views.image_size
    points = camera_to_world_points(cameras, pixel_rays(cameras, *size) * sample.depth[..., None])
    centre = points[: sample.num_context].reshape(-1, 3).median(dim=0).values
    distance = (points - centre).norm(dim=-1)
    opaque = (distance < distance[: sample.num_context].flatten().quantile(SHARE_WITHIN)).float()
    return F.avg_pool2d(F.pad(opaque[:, None], (1, 1, 1, 1), mode="replicate"), 3, 1)[:, 0]


@torch.no_grad()
def quality_of(codec: Codec, sample: Sample, lambda_q: int) -> dict[str, float]:
    """Encode and decode a cut-out object, and return its size in KiB and its PSNR on each background."""
    opacity, colour, views = opacity_of(sample), sample.views.images, sample.views
    visible = colour * opacity[:, None]
    cut_out = replace(views, images=visible + 1.0 - opacity[:, None], alpha=opacity)
    data = encode_with(codec, cut_out.select(list(range(sample.num_context))), lambda_q)
    rendering = render(decode_with(codec.receiver, data).gaussians, views.cameras, views.image_size)
    found = {"KiB": len(data) / 1024}
    for name, level in LEVELS.items():
        image = (rendering.color + level * (1.0 - rendering.alpha[:, None])).clamp(0, 1)
        quality = psnr(image, visible + level * (1.0 - opacity[:, None]))
        found[f"{name}, context"] = float(quality[: sample.num_context].mean())
        found[f"{name}, target"] = float(quality[sample.num_context :].mean())
    return found


def main() -> None:
    """Print the means over scenes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="folder of the weights")
    parser.add_argument("--textures", type=Path, help="folder of images for textures, besides the built-in patterns")
    parser.add_argument("--scenes", type=int, default=8, help="number of scenes  [default: 8]")
    parser.add_argument("--views", type=int, default=2, help="number of context views  [default: 2]")
    parser.add_argument("--lmbda", type=float, default=1e-3)
    arguments = parser.parse_args()
    textures = pattern_textures(NUM_PATTERNS)
    if arguments.textures is not None:
        textures += textures_from_folder(arguments.textures)
    codec, world, generator = load_codec(arguments.model, "cpu"), ProceduralWorld(textures), torch.Generator()
    generator.manual_seed(SEED)
    rows = []
    for _ in range(arguments.scenes):
        sample = world.sample(generator, num_context=arguments.views, num_target=NUM_TARGET, size=(256, 256))
        rows.append(quality_of(codec, sample, quantise_lambda(arguments.lmbda)))
    for name in rows[0]:
        print(f"{name}\t{mean(row[name] for row in rows):.2f}")


if __name__ == "__main__":
    main()
