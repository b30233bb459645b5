"""Draw `docs/overview.webp`, the first picture of the README: `python benchmarks/make_readme_picture.py`.

The first column shows the photographs. Each other column shows one encoded file of the bundled scene, made and rendered
by the command line with default options: the left camera above, a camera half-way between the two below.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from fecocodec.photographs.images import read_image
from fecocodec.rendering.metrics import psnr

ROOT = Path(__file__).resolve().parent.parent
SCENE = ROOT / "examples" / "motorcycle"
OUTPUT = ROOT / "docs" / "overview.webp"
LAMBDAS = ("1e-2", "1e-3")
CAPTION_PX, GAP_PX, FONT_PX = 28, 6, 17


def main() -> None:
    photographs = [Image.open(SCENE / "images" / name).convert("RGB") for name in ("left.png", "right.png")]
    columns = [("photographs, 2 x 384x256 pixels", "left", photographs[0], "right", photographs[1])]
    with tempfile.TemporaryDirectory() as name:
        columns += [_decoded_column(Path(name), lmbda) for lmbda in LAMBDAS]
    _draw(columns).save(OUTPUT, quality=84, method=6)


def _decoded_column(folder: Path, lmbda: str) -> tuple[str, str, Image.Image, str, Image.Image]:
    """Return (heading, caption, image at the left camera, caption, image at the camera half-way)."""
    stream, cameras = folder / f"{lmbda}.fcs", folder / "between"
    _fecosplat("encode", SCENE, "-o", stream, "--lambda", lmbda)
    _fecosplat("render", stream, "-o", folder / lmbda)
    _write_camera_between(cameras)
    _fecosplat("render", stream, "--cameras", cameras, "-o", folder / f"{lmbda}-between")
    left = min((folder / lmbda).glob("*.png"))
    between = min((folder / f"{lmbda}-between").glob("*.png"))
    quality = psnr(read_image(left)[None], read_image(SCENE / "images" / "left.png")[None]).item()
    heading = f"lambda {lmbda}: {stream.stat().st_size / 1024:.1f} KiB"
    return heading, f"left, {quality:.1f} dB", Image.open(left), "new view, half-way", Image.open(between)


def _write_camera_between(folder: Path) -> None:
    """Write a `transforms.json` with one camera half-way. The bundled cameras are parallel: only positions differ."""
    scene = json.loads((SCENE / "transforms.json").read_text())
    left, right = scene["frames"]
    for row in range(3):
        left["transform_matrix"][row][3] = (left["transform_matrix"][row][3] + right["transform_matrix"][row][3]) / 2
    for key in ("fl_x", "fl_y", "cx", "cy"):
        left[key] = (left[key] + right[key]) / 2
    left["file_path"] = str(SCENE / left["file_path"])
    folder.mkdir(exist_ok=True)
    (folder / "transforms.json").write_text(json.dumps({**scene, "frames": [left]}))


def _fecosplat(*arguments: object) -> None:
    subprocess.run([sys.executable, "-m", "fecosplat_cli", *map(str, arguments)], check=True)


def _draw(columns: list[tuple[str, str, Image.Image, str, Image.Image]]) -> Image.Image:
    """Draw each column: a heading and two images with captions."""
    width, height = columns[0][2].size
    row = height + CAPTION_PX
    sheet = Image.new("RGB", (len(columns) * (width + GAP_PX) - GAP_PX, 2 * row + CAPTION_PX), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(FONT_PX)
    for index, (heading, above, first, below, second) in enumerate(columns):
        x = index * (width + GAP_PX)
        draw.text((x + 4, 3), heading, "black", font)
        for number, (caption, picture) in enumerate(((above, first), (below, second))):
            sheet.paste(picture, (x, CAPTION_PX + number * row))
            draw.text((x + 4, CAPTION_PX + number * row + height + 2), caption, "dimgray", font)
    return sheet


if __name__ == "__main__":
    main()
