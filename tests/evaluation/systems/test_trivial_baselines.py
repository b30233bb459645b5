"""Baselines: what is sent is what is counted, and comes back as what it was."""

import sys

import pytest
import torch

from fecocodec.coding.camera_packing import unpack
from fecocodec.errors import InputError
from fecocodec.evaluation.systems.gaussian_compression import decode_spz, encode_spz
from fecocodec.evaluation.systems.gaussian_maps import GAINS, decode_maps, encode_maps, maps_of, prediction_of
from fecocodec.evaluation.systems.image_compression import QUALITY_LADDERS, decode_image, encode_image
from fecocodec.evaluation.systems.trivial_baselines import trivial_baselines
from fecocodec.evaluation.systems.uncoded import uncoded
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.rendering.metrics import psnr
from fecocodec.sender.codec import Codec
from fecocodec.sender.optimisation_config import FAST
from tests.example_scenes import example_views


@pytest.mark.parametrize("codec", QUALITY_LADDERS)
def test_a_ladder_rises_in_bytes_and_quality(codec: str) -> None:
    image = example_views(1, 64, 96).images[0]
    files = [encode_image(image, codec, quality) for quality in QUALITY_LADDERS[codec]]
    qualities = [float(psnr(decode_image(file, codec), image)) for file in files]
    sizes = [len(file) for file in files]
    assert sizes == sorted(sizes) and len(set(sizes)) == len(sizes)
    assert qualities == sorted(qualities) and qualities[-1] > qualities[0] + 2


def test_gaussians_come_back() -> None:
    generator = torch.Generator().manual_seed(0)
    gaussians = Gaussians(
        means=torch.randn(300, 3, generator=generator),
        scales=0.01 + 0.1 * torch.rand(300, 3, generator=generator),
        rotations=torch.nn.functional.normalize(torch.randn(300, 4, generator=generator), dim=-1),
        opacities=0.1 + 0.8 * torch.rand(300, generator=generator),
        harmonics=torch.randn(300, 1, 3, generator=generator),
    )
    data = encode_spz(gaussians)
    found = decode_spz(data)
    assert found.count == 300 and len(data) < 300 * 24
    for mine, theirs in zip(gaussians.means.T, found.means.T, strict=True):  # SPZ may reorder
        torch.testing.assert_close(mine.sort()[0], theirs.sort()[0], atol=5e-3, rtol=0)
    torch.testing.assert_close(gaussians.opacities.sort()[0], found.opacities.sort()[0], atol=1e-2, rtol=0)


def test_attributes_come_back_from_images(codec: Codec) -> None:
    scene = uncoded(codec, example_views(2, 64, 96), FAST)
    cameras = normalise_scene(unpack(scene.packed))[0].as_batch()
    exact = codec.receiver.predict(scene.state.state, cameras, scene.state.condition).attributes
    maps = maps_of(codec.receiver, scene)
    found = prediction_of(maps, cameras).attributes
    same_rotations = (exact.rotations * found.rotations).sum(dim=-1).abs()  # q and -q are the same
    torch.testing.assert_close(same_rotations, torch.ones_like(same_rotations), atol=1e-4, rtol=0)
    for name in ("means", "scales", "opacity", "colour", "depth"):
        torch.testing.assert_close(getattr(found, name), getattr(exact, name), atol=2e-3, rtol=2e-3)
    files = [encode_maps(maps, qp) for qp in (4, 30)]
    errors = [(decode_maps(file, 2) - maps).abs().amax(dim=(0, 2, 3)) for file in files]
    assert len(files[1]) < len(files[0]) / 2 and all((errors[0] * torch.tensor(GAINS) < 0.01).tolist())
    assert float(errors[1].mean()) > float(errors[0].mean())


def test_floor_of_equal_cameras_is_exact() -> None:
    """Where the target's camera is a context view's, the nearest view and every plane give that view back."""
    views = example_views(2).select([0, 0])
    for system in trivial_baselines():
        found = system.reconstruct(views, 1)
        torch.testing.assert_close(found.images[1], views.images[0], atol=1e-3, rtol=0)


def test_a_missing_library_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imagecodecs", None)
    with pytest.raises(InputError, match=r"AVIF needs the package imagecodecs.*pip install '\.\[eval\]'"):
        encode_image(example_views(1).images[0], "AVIF", 50.0)
