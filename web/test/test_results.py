"""Compare what the browser tests left in web/build/browser with the Python receiver. Run by `make web-test`.

`pageN.png` are screenshots of the self-contained page at the coded cameras, `page-thumbnailN.png` its thumbnails, and
`ply.png` and `spz.png` pictures of pages of Gaussians without cameras.
If the page that decodes was built, `cameraN.png` are its screenshots, `thumbnailN.png` its thumbnails,
`preview1.png` is its picture after stage 1, `scene.ply` and `scene.spz` its downloads, and `views-N.ply` are its
downloads for the scenes of `make_scenes.py`.
"""

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.decode import Decoded, decode
from fecocodec.rendering.rasterizer import render
from fecocodec.splat_files.gaussian_arrays import CameraArrays, gaussian_arrays
from fecocodec.splat_files.gaussian_files import in_frame
from fecocodec.splat_files.html_page import FOLDER
from fecocodec.splat_files.ply import read_ply
from fecocodec.splat_files.spz import spz_bytes
from tests.vectors.gaussian_difference import beyond, difference
from tests.vectors.gaussian_samples import table
from tests.vectors.tiny_model import VECTORS
from web.test.make_scenes import NUM_VIEWS

RESULTS = Path(__file__).parents[1] / "build" / "browser"
STREAM = (VECTORS / "valid/scene-compact-6.fcs").read_bytes()
LEAST_PSNR = 30.0  # dB; the browser sorts and rounds splats in its own way
needs_decoder_page = pytest.mark.skipif(
    not (FOLDER / "index.html").exists(), reason="the page that decodes was not built: no model has all graphs"
)


@pytest.fixture(scope="module")
def decoded() -> Decoded:
    return decode(STREAM, merging=None)  # browsers do not merge


@needs_decoder_page
def test_the_gaussians_agree(decoded: Decoded) -> None:
    found = difference(STREAM, table(decoded.gaussians), table(read_ply(RESULTS / "scene.ply")))
    assert beyond(found, "full") == [], found


@needs_decoder_page
def test_the_spz_file_is_that_of_python() -> None:
    """Values halfway between two steps may be rounded to either.

    The page rounds halves up, Python to even; and Python has scales where the .ply file has their logarithms, so that
    it packs -4.031250003 for the -4.03125 of the file.
    """
    gaussians = gaussian_arrays(read_ply(RESULTS / "scene.ply"), "scene.ply")
    files = (spz_bytes(gaussians, "scene.spz", 3), (RESULTS / "scene.spz").read_bytes())
    ours, found = (np.frombuffer(gzip.decompress(file), np.uint8) for file in files)
    assert len(found) == len(ours)
    positions = slice(16, 16 + 9 * gaussians.count)
    rest = np.abs(np.delete(found, np.r_[positions]).astype(int) - np.delete(ours, np.r_[positions]))
    assert rest.max() <= 1 and np.count_nonzero(rest) < 1e-4 * rest.size
    fixed = [file[positions].reshape(-1, 3) @ np.array([1, 256, 65536]) for file in (found, ours)]
    assert np.abs((fixed[0] - fixed[1] + 2**23) % 2**24 - 2**23).max() <= 1


@needs_decoder_page
@pytest.mark.parametrize("num_views", NUM_VIEWS)
def test_the_gaussians_of_other_numbers_of_views_agree(num_views: int) -> None:
    data = (RESULTS / "scenes" / f"views-{num_views}.fcs").read_bytes()
    ours, shown = decode(data, merging=None).gaussians, read_ply(RESULTS / f"views-{num_views}.ply")
    found = difference(data, padded(ours), padded(shown))
    assert beyond(found, "full") == [], found


def padded(gaussians: Gaussians) -> torch.Tensor:
    """Return rows as `table` does, with zeros for missing harmonics of degree 1."""
    missing = 4 - gaussians.harmonics.shape[1]
    return table(replace(gaussians, harmonics=torch.nn.functional.pad(gaussians.harmonics, (0, 0, 0, missing))))


@pytest.mark.parametrize("view", [0, 1])
def test_the_self_contained_page_resembles_the_rendering(decoded: Decoded, view: int) -> None:
    assert psnr(decoded, view, RESULTS / f"page{view + 1}.png") > LEAST_PSNR


@pytest.mark.parametrize("kind", ["ply", "spz"])
def test_the_first_view_of_gaussians_alone_is_that_from_the_origin_to_their_middle(decoded: Decoded, kind: str) -> None:
    size = (300, 450)
    extrinsics, intrinsics, near, far = (field.numpy().astype(float) for field in decoded.cameras.fields())
    cameras = CameraArrays(extrinsics, intrinsics, float(near), float(far), size)
    gaussians, _, _ = in_frame("first-camera", gaussian_arrays(decoded.gaussians, "scene"), cameras)
    forward = np.quantile(gaussians.means, 0.5, axis=0, method="lower")
    forward /= np.linalg.norm(forward)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    pose = torch.eye(4)
    pose[:3, :3] = torch.from_numpy(np.stack((right, np.cross(forward, right), forward), axis=1)).float()
    lens = torch.tensor([[0.9 * size[0] / size[1], 0, 0.5], [0, 0.9, 0.5], [0, 0, 1]])
    camera = Cameras(pose[None], lens[None], torch.tensor(float(near)), torch.tensor(float(far)))
    tensors = Gaussians(*(torch.from_numpy(field).float() for field in gaussians.fields()))
    with torch.no_grad():
        rendering = render(tensors, camera, size).color[0].clamp(0, 1)
    assert psnr_of(rendering, RESULTS / f"{kind}.png") > LEAST_PSNR


@pytest.mark.parametrize("view", [0, 1])
def test_the_thumbnails_resemble_the_rendering(decoded: Decoded, view: int) -> None:
    """They are as large as these small images."""
    assert psnr(decoded, view, RESULTS / f"page-thumbnail{view + 1}.png") > LEAST_PSNR


@needs_decoder_page
@pytest.mark.parametrize("view", [0, 1])
def test_the_thumbnails_of_the_decoder_page_resemble_the_rendering(decoded: Decoded, view: int) -> None:
    assert psnr(decoded, view, RESULTS / f"thumbnail{view + 1}.png") > LEAST_PSNR


@needs_decoder_page
@pytest.mark.parametrize("view", [0, 1])
def test_the_decoder_page_resembles_the_rendering(decoded: Decoded, view: int) -> None:
    assert psnr(decoded, view, RESULTS / f"camera{view + 1}.png") > LEAST_PSNR


@needs_decoder_page
def test_the_preview_resembles_the_rendering_of_stage_1() -> None:
    assert psnr(decode(STREAM, stages=1), 0, RESULTS / "preview1.png") > LEAST_PSNR


def psnr(decoded: Decoded, view: int, screenshot: Path) -> float:
    """Return the PSNR of a screenshot against the rendering of the decoded Gaussians at a coded camera."""
    with torch.no_grad():
        rendered = render(decoded.gaussians, decoded.cameras, decoded.image_size).color[view].clamp(0, 1)
    return psnr_of(rendered, screenshot)


def psnr_of(rendered: torch.Tensor, screenshot: Path) -> float:
    """Return the PSNR of a screenshot against a rendering, [3 height width] in [0, 1]."""
    shown = np.asarray(Image.open(screenshot).convert("RGB"), dtype=np.float64) / 255
    error = np.square(shown - rendered.permute(1, 2, 0).double().numpy()).mean()
    return float(-10 * np.log10(error))
