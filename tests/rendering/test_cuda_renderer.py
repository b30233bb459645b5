"""Conventions between the CUDA renderer and gsplat, with a replacement of gsplat that renders on the CPU."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from small_scenes import random_gaussians, two_cameras

from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.cuda import BACKEND, render_on_cuda
from fecocodec.rendering.rasterizer import render

IMAGE_SIZE = (24, 40)
BACKGROUND = (0.1, 0.2, 0.3)


def rasterization(**arguments) -> tuple[torch.Tensor, torch.Tensor, dict]:
    """gsplat 1.5's function for the arguments we use: OpenCV cameras in pixels in, [C H W 4] and [C H W 1] out."""
    width, height = arguments["width"], arguments["height"]
    cameras = Cameras(
        extrinsics=torch.linalg.inv(arguments["viewmats"]),
        intrinsics=arguments["Ks"] / torch.tensor([width, height, 1.0])[:, None],
        near=torch.tensor(10.0 * arguments["near_plane"]),
        far=torch.tensor(1e10),
    )
    gaussians = Gaussians(
        arguments["means"], arguments["scales"], arguments["quats"], arguments["opacities"], arguments["colors"]
    )
    assert gaussians.harmonics.shape[1] == (arguments["sh_degree"] + 1) ** 2
    assert arguments["render_mode"] == "RGB+ED"
    assert arguments["backgrounds"].shape == (cameras.num_views, 3)
    rendering = render(gaussians, cameras, (height, width), tuple(arguments["backgrounds"][0].tolist()))
    images = torch.cat((rendering.color, rendering.depth[:, None]), dim=1).permute(0, 2, 3, 1)
    return images, rendering.alpha[..., None], {}


@pytest.fixture
def gsplat(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, kernels=object())


def install(monkeypatch: pytest.MonkeyPatch, kernels: object) -> None:
    """Stand in for gsplat. kernels: its compiled module, None if it has found no compiler."""
    monkeypatch.setitem(sys.modules, "gsplat", SimpleNamespace(rasterization=rasterization))
    monkeypatch.setitem(sys.modules, "gsplat.cuda", SimpleNamespace())
    monkeypatch.setitem(sys.modules, BACKEND, SimpleNamespace(_C=kernels))


@pytest.mark.usefixtures("gsplat")
def test_cameras_and_gaussians_arrive_in_gsplats_conventions() -> None:
    gaussians = random_gaussians(50, num_harmonics=9)
    ours = render_on_cuda(gaussians, two_cameras(), IMAGE_SIZE, BACKGROUND, near=0.05)
    expected = render(gaussians, two_cameras(), IMAGE_SIZE, BACKGROUND)
    torch.testing.assert_close(ours.color, expected.color, atol=1e-4, rtol=0)
    torch.testing.assert_close(ours.depth, expected.depth, atol=1e-3, rtol=0)
    torch.testing.assert_close(ours.alpha, expected.alpha, atol=1e-4, rtol=0)


@pytest.mark.usefixtures("gsplat")
def test_what_cannot_be_drawn_does_not_reach_gsplat() -> None:
    gaussians = random_gaussians(20)
    scales = gaussians.scales.clone()
    scales[4, 1] = torch.nan
    rendering = render_on_cuda(replace(gaussians, scales=scales), two_cameras(), IMAGE_SIZE, BACKGROUND, near=0.05)
    assert rendering.color.isfinite().all()
    rendering = render_on_cuda(random_gaussians(0), two_cameras(), IMAGE_SIZE, BACKGROUND, near=0.05)
    assert torch.equal(rendering.color, torch.tensor(BACKGROUND)[:, None, None].expand(2, 3, *IMAGE_SIZE))
    assert not rendering.alpha.any()


def test_missing_gsplat_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gsplat", None)
    with pytest.raises(InputError, match="gsplat, which is not installed; run `pip install gsplat`"):
        render_on_cuda(random_gaussians(1), two_cameras(), IMAGE_SIZE, BACKGROUND, near=0.05)


def test_gsplat_without_a_compiler_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, kernels=None)
    with pytest.raises(InputError, match=r"gsplat found no CUDA toolkit \(nvcc\) .* or use the CPU by `device`"):
        render_on_cuda(random_gaussians(1), two_cameras(), IMAGE_SIZE, BACKGROUND, near=0.05)


def test_the_first_import_keeps_stdout_clean_and_names_a_failed_compilation(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    package = tmp_path / "gsplat" / "cuda"
    package.mkdir(parents=True)
    (package.parent / "__init__.py").write_text("rasterization = None\n")
    (package / "__init__.py").touch()
    (package / "_backend.py").write_text('print("compiling")\nraise RuntimeError("Error building\\nlong output")\n')
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("gsplat", "gsplat.cuda"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(InputError, match=r"cannot be loaded \(Error building\); install .* the CUDA toolkit"):
        render_on_cuda(random_gaussians(1), two_cameras(), IMAGE_SIZE, BACKGROUND, near=0.05)
    written = capsys.readouterr()
    assert (written.out, written.err) == ("", "compiling\n")


def test_what_gsplat_lacks_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "gsplat.py").write_text("import a_missing_package\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "gsplat", raising=False)
    with pytest.raises(InputError, match=r"gsplat, .*, cannot be loaded \(No module named 'a_missing_package'\);"):
        render_on_cuda(random_gaussians(1), two_cameras(), IMAGE_SIZE, BACKGROUND, near=0.05)
