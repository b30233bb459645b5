"""The bundled scene, as a stranger meets it: separate processes, files on disk."""

import subprocess
import sys
from pathlib import Path

import pytest

from fecocodec.photographs.images import read_image
from fecocodec.rendering.metrics import psnr

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "examples" / "motorcycle"


@pytest.mark.slow
def test_bundled_scene_goes_through_the_codec(tmp_path: Path) -> None:
    def fecosplat(*arguments: object) -> None:
        subprocess.run([sys.executable, "-m", "fecosplat_cli", *map(str, arguments)], check=True)

    stream, ply, images = (tmp_path / name for name in ("demo.fcs", "demo.ply", "images"))
    fecosplat("encode", SCENE, "-o", stream, "--lambda", "1e-4")
    fecosplat("info", stream)
    fecosplat("decode", stream, "-o", ply)
    fecosplat("render", stream, "-o", images)
    rendered = read_image(images / "demo_00.png")
    photograph = read_image(SCENE / "images" / "left.png")
    assert ply.stat().st_size > 1_000_000
    assert psnr(rendered[None], photograph[None]).item() > 18.0  # dB; a recognisable scene
