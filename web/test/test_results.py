"""Compare what the browser tests left in web/build/browser with the Python receiver. Run by `make web-test`.

`scene.ply` is the page's download, `cameraN.png` are screenshots at the coded cameras.
"""

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from fecocodec.formats.ply import read_ply
from fecocodec.receiver.decode import Decoded, decode
from fecocodec.rendering.rasterizer import render
from tests.vectors.gaussian_difference import beyond, difference
from tests.vectors.gaussian_samples import table
from tests.vectors.tiny_model import VECTORS

RESULTS = Path(__file__).parents[1] / "build" / "browser"
STREAM = (VECTORS / "valid/scene-compact-2.fcs").read_bytes()
LEAST_PSNR = 25.0  # dB; the browser sorts and rounds splats in its own way


@pytest.fixture(scope="module")
def decoded() -> Decoded:
    return decode(STREAM)


def test_the_gaussians_agree(decoded: Decoded) -> None:
    found = difference(STREAM, table(decoded.gaussians), table(read_ply(RESULTS / "scene.ply")))
    assert beyond(found, "full") == [], found


@pytest.mark.parametrize("name", ["camera1.png", "camera2.png", "page1.png"])
def test_a_screenshot_resembles_the_rendering(decoded: Decoded, name: str) -> None:
    view = int(name.removesuffix(".png")[-1]) - 1
    with torch.no_grad():
        rendered = render(decoded.gaussians, decoded.cameras, decoded.image_size).color[view].clamp(0, 1)
    shown = np.asarray(Image.open(RESULTS / name).convert("RGB"), dtype=np.float64) / 255
    error = np.square(shown - rendered.permute(1, 2, 0).double().numpy()).mean()
    assert -10 * np.log10(error) > LEAST_PSNR
