"""The novel-view protocol on real bytes."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec.captures.evaluation_index import IndexEntry
from fecocodec.container import quantise_lambda
from fecocodec.evaluation.novel_views import render_views
from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.run import measure
from fecocodec.evaluation.systems import codec as systems
from fecocodec.evaluation.systems.codec import codec_system, guided_system
from fecocodec.evaluation.systems.reconstruction import System
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode
from fecocodec.rendering.metrics import psnr
from fecocodec.sender.codec import load_codec
from fecocodec.sender.encode import encode_with
from fecocodec.sender.optimisation_config import FAST
from tests.example_scenes import MODEL, example_views


def measured(system: System, views: Views, guide: tuple[int, ...] = ()) -> Measurement:
    """Code two views, and measure the third."""
    entry = IndexEntry("scene/label", "scene", (0, 1), (2,), guide)
    return measure((entry.name, "", "", "", ""), entry, system, views)


def test_a_measurement_is_that_of_the_bytes(random_weights: Path) -> None:
    codec, views = load_codec(random_weights / MODEL, "cpu"), example_views(3)
    found = measured(codec_system(codec, 1e-3, effort="fast"), views)
    data = encode_with(codec, views.select([0, 1]), quantise_lambda(1e-3), 2, FAST)
    gaussians = decode(data, model=random_weights / MODEL).gaussians
    assert found.num_bytes == len(data)
    assert found.num_gaussians == gaussians.count
    rendered = render_views(gaussians, views)
    assert rendered.shape == views.images.shape
    assert float(rendered.min()) >= 0.0 and float(rendered.max()) <= 1.0
    by_hand = -10 * torch.log10((rendered - views.images).square().flatten(1).mean(dim=1))
    torch.testing.assert_close(psnr(rendered, views.images), by_hand, atol=1e-3, rtol=0)
    assert found.psnr == pytest.approx(float(by_hand[2]), abs=1e-3)
    assert found.context_psnr == pytest.approx(float(by_hand[:2].mean()), abs=1e-3)
    assert -1.0 <= found.ssim <= 1.0


def test_guides_teach_systems_that_learn_alone(random_weights: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    codec, views = load_codec(random_weights / MODEL, "cpu"), example_views(4)
    taught: list[Views | None] = []

    def encode(*arguments: object, guides: Views | None = None, **options: object) -> bytes:
        taught.append(guides)
        return encode_with(*arguments, **options)

    monkeypatch.setattr(systems, "encode_with", encode)
    found = [measured(of(codec, 1e-3, effort="fast"), views, (3,)) for of in (guided_system, codec_system)]
    assert found[0].num_bytes == found[1].num_bytes and found[0].psnr == found[1].psnr
    assert taught[0] is not None and torch.equal(taught[0].images, views.images[3:]) and taught[1] is None


def test_guides_that_are_left_out_do_not_count(random_weights: Path) -> None:
    codec, views = load_codec(random_weights / MODEL, "cpu"), example_views(4)
    context, guides = views.select([0, 1, 2]), views.select([1])
    system = guided_system(codec, 1e-3, effort="fast")
    wrong = replace(guides, images=1.0 - guides.images)
    found = [system.run(context, 2, shown) for shown in (guides, wrong, None)]
    assert [one.num_guides for one in found] == [1, 0, 0]
    assert [any("is left out" in warning for warning in one.warnings) for one in found] == [False, True, False]


def test_pixels_under_masks_do_not_count(random_weights: Path) -> None:
    views = example_views(3)
    ignored = torch.zeros(3, 64, 64, dtype=torch.bool)
    ignored[:, :40] = True
    masked = replace(views, ignored=ignored)
    spoiled = replace(masked, images=torch.where(ignored[:, None], 1.0 - views.images, views.images))
    system = codec_system(load_codec(random_weights / MODEL, "cpu"), 1e-3, effort="fast")
    found = [measured(system, of) for of in (masked, spoiled)]
    assert found[0].num_bytes == found[1].num_bytes
    assert found[0].psnr == found[1].psnr and found[0].context_psnr == found[1].context_psnr
    assert measured(system, replace(spoiled, ignored=None)).psnr != found[0].psnr
