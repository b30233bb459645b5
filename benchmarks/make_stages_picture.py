"""Draw docs/report/stages.webp: `python benchmarks/make_stages_picture.py ROOT INDEX [--entry NAME] [--lambda 1e-3]`.

A new view of one pair: what stage 1 and both stages of one file give, each with its error and its numbers. Below, what
the baselines of `fecosplat eval` give whose size is nearest to that of the file. Errors are drawn at four times their
size.
"""

import argparse
from pathlib import Path

import torch
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from fecocodec.captures.evaluation_index import read_index
from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED
from fecocodec.container import quantise_lambda, read_stream
from fecocodec.evaluation.evaluation import ERROR_GAIN, in_colour
from fecocodec.evaluation.novel_views import open_scenes
from fecocodec.evaluation.systems.codec import rendered
from fecocodec.evaluation.systems.groups import WHATEVER_LAMBDA
from fecocodec.evaluation.systems.reconstruction import Reconstruction
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.lpips import lpips_vgg
from fecocodec.rendering.metrics import psnr
from fecocodec.sender.codec import load_codec
from fecocodec.sender.encode import encode_with

OUTPUT = Path("docs/report/stages.webp")
OPTIMISED = "AVIF, optimised at the receiver"
SIZE, CAPTION_PX, FONT_PX = (256, 256), 22, 14


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="folder of scenes")
    parser.add_argument("index", type=Path, help="evaluation index (JSON)")
    parser.add_argument("--entry", default="llff_horns/mid1", help="a pair of the index  [default: llff_horns/mid1]")
    parser.add_argument("--lambda", dest="lmbda", type=float, default=1e-3, help="of the file  [default: 1e-3]")
    arguments = parser.parse_args()
    entry = next(entry for entry in read_index(arguments.index) if entry.name == arguments.entry)
    views, count = open_scenes(arguments.root, SIZE)(entry), len(entry.context)
    codec, context = load_codec(SHIPPED / DEFAULT_MODEL, "cpu"), views.select(list(range(count)))
    data = encode_with(codec, context, quantise_lambda(arguments.lmbda), 2)
    first, both = (decode_with(codec.receiver, data, stages=stages).gaussians for stages in (1, 2))
    of_stage = [len(payload) for payload in read_stream(data).payloads]
    pictures = [[("a photograph that is not coded", views.images[count])], []]
    pictures[0] += panels("stage 1", rendered(first, views, len(data) - of_stage[1], 0.0, 0.0), views, count)
    pictures[0] += panels("both stages", rendered(both, views, len(data), 0.0, 0.0), views, count)
    systems = [system for group in ("images", "gaussians") for system in WHATEVER_LAMBDA[group](codec)]
    for name in ("AVIF", "Gaussians as HEVC"):
        found = {one.setting: one.reconstruct(views, count) for one in systems if one.name == name}
        setting = min(found, key=lambda one: abs(found[one].num_bytes - len(data)))
        pictures[1] += panels(name, found[setting], views, count)
        optimised = [one for one in systems if (one.name, one.setting) == (OPTIMISED, setting)]
        for system in optimised:
            pictures[1] += panels(system.name, system.reconstruct(views, count), views, count)
    draw(pictures).save(OUTPUT, quality=86, method=6)


def panels(name: str, found: Reconstruction, views: Views, number: int) -> list[tuple[str, Tensor]]:
    """Return the rendering of a view and its error, each with a caption. number: of the view."""
    photograph, picture = views.images[number : number + 1], found.images[number : number + 1]
    distance, quality = lpips_vgg(picture, photograph).item(), psnr(picture, photograph).item()
    caption = f"{found.num_bytes / 1024:.1f} KiB, {quality:.1f} dB, LPIPS {distance:.2f}"
    return [(name, picture[0]), (caption, in_colour((picture - photograph)[0].abs().mean(dim=0) * ERROR_GAIN))]


def draw(rows: list[list[tuple[str, Tensor]]]) -> Image.Image:
    """Draw rows of pictures with captions above them."""
    height, width = SIZE
    sheet = Image.new("RGB", (width * max(map(len, rows)), (height + CAPTION_PX) * len(rows)), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(FONT_PX)
    for row, pictures in enumerate(rows):
        for column, (caption, picture) in enumerate(pictures):
            place = column * width, row * (height + CAPTION_PX)
            pen.text((place[0] + 3, place[1] + 3), caption, "black", font)
            pixels = (picture.clamp(0, 1) * 255).round().to(torch.uint8).permute(1, 2, 0).contiguous().numpy()
            sheet.paste(Image.fromarray(pixels), (place[0], place[1] + CAPTION_PX))
    return sheet


if __name__ == "__main__":
    main()
