"""Photographs that are not coded teach the sender; those that do not fit the coded ones are left out, and named."""

from dataclasses import replace

import pytest
import torch

from fecocodec import encode
from fecocodec.container import quantise_lambda, read_stream
from fecocodec.evaluation.novel_views import render_views
from fecocodec.geometry.views import Views
from fecocodec.grid import LATENTS
from fecocodec.receiver.decode import decode
from fecocodec.rendering.metrics import psnr
from fecocodec.sender.codec import Codec
from fecocodec.sender.detail_steps import search_of
from fecocodec.sender.encode import matched_scene, write_stages
from fecocodec.sender.optimisation_config import DEFAULT, FAST
from fecocodec.sender.references import MAX_GUIDES_AT_ONCE, References
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from tests.example_scenes import synthetic_views

SIZE = (64, 96)


@pytest.fixture(scope="module")
def views() -> Views:
    """Eight views of a room, the first two of them context views."""
    return synthetic_views(2, 6, SIZE)


def quality(data: bytes, views: Views) -> float:
    return float(psnr(render_views(decode(data).gaussians, views), views.images).mean())


def test_guides_raise_the_quality_where_they_are(views: Views) -> None:
    context, guides = views.select([0, 1]), views.select([2, 3])
    plain, guided = encode(context), encode(context, guides=guides)
    assert quality(guided, guides) > quality(plain, guides)
    assert encode(context, guides=guides.select([]), effort="fast") == encode(context, effort="fast")


def test_a_guide_of_another_scene_is_left_out_and_named(shipped_codec: Codec, views: Views) -> None:
    context, guides = views.select([0, 1]), views.select([2, 3])
    row, column = torch.meshgrid(torch.arange(SIZE[0]) // 16, torch.arange(SIZE[1]) // 16, indexing="ij")
    board = ((row + column) % 2).float().expand(1, 3, *SIZE)
    spoiled = replace(guides, images=torch.cat((guides.images[:1], board)), names=("good.jpg", "bad.jpg"))
    said: list[str] = []
    _, scene = matched_scene(shipped_codec, context, spoiled, said.append)
    assert scene.guides is not None and scene.guides.count == 1
    (sentence,) = [sentence for sentence in said if "guide" in sentence]
    assert sentence.startswith("guide bad.jpg is left out: ")
    assert "good.jpg" not in sentence


def test_guides_are_brightened_or_left_out(shipped_codec: Codec, views: Views) -> None:
    context, guides = views.select([0, 1]), views.select([2, 3])
    dark = replace(guides, images=0.6 * guides.images)
    _, scene = matched_scene(shipped_codec, context, dark, lambda _: None)
    assert scene.guides is not None
    before, after = ((images - guides.images).abs().mean() for images in (dark.images, scene.guides.images))
    assert after < 0.5 * before
    cut_out = replace(context, alpha=torch.ones(2, *SIZE))
    said: list[str] = []
    _, scene = matched_scene(shipped_codec, cut_out, guides, said.append)
    assert scene.guides is None
    assert said[0] == "the guides are left out: the coded views are cut-outs and the guides are not."


@torch.no_grad()
@pytest.mark.parametrize(("num_coded", "num_guides", "coefficients"), [(4, 0, 1), (4, 3, 1), (4, 4, 4), (3, 3, 1)])
def test_detail_is_found_with_colours_by_direction_where_enough_guides_judge_it(
    shipped_codec: Codec, views: Views, num_coded: int, num_guides: int, coefficients: int
) -> None:
    guides = views.select(list(range(num_coded, num_coded + num_guides))) if num_guides else None
    scene = prepare_scene(views.select(list(range(num_coded))), shipped_codec.device, guides)
    encoder, lambda_q = SceneEncoder.of(shipped_codec, scene), quantise_lambda(1e-4)
    search = search_of(encoder, write_stages(encoder, lambda_q, 2, FAST)[-1], lambda_q)
    planes = len(shipped_codec.receiver.detail_basis.basis)
    values = torch.zeros(num_coded, planes, SIZE[0] // LATENTS, SIZE[1] // LATENTS)
    assert search.gaussians(values).harmonics.shape[1] == coefficients
    assert search.as_decoded(values).harmonics.shape[1] == 4


def test_bits_go_from_latents_to_detail_where_enough_guides_judge_it(views: Views) -> None:
    context, guides = views.select([0, 1, 2, 3]), views.select([4, 5, 6, 7])
    few_steps = DEFAULT.with_steps(2)  # of a single one, guides would make twice as many
    plain, guided = (read_stream(encode(context, guides=of, effort=few_steps)) for of in (None, guides))
    assert guided.header.lambda_q == quantise_lambda(2.5e-3)
    assert plain.header.lambda_q == quantise_lambda(1e-3)
    assert all(len(taught) < len(alone) for taught, alone in zip(guided.payloads, plain.payloads, strict=True))
    assert guided.detail and plain.detail and len(guided.detail.payload) > len(plain.detail.payload)


@torch.no_grad()
def test_all_guides_teach_in_turns(shipped_codec: Codec, views: Views) -> None:
    context, guides = views.select([0, 1]), views.select([2, 3, 4, 5] * 5)
    references = References.of(SceneEncoder.of(shipped_codec, prepare_scene(context, shipped_codec.device, guides)))
    turns = [references.taught(number) for number in range(3)]
    assert all(turn.num_context == 2 and len(turn.images) <= 2 + MAX_GUIDES_AT_ONCE for turn in turns)
    assert all(torch.equal(turn.images[:2], references.images[:2]) for turn in turns)
    assert sum(len(turn.images) - 2 for turn in turns) == 20
