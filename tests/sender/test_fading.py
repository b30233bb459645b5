"""Blocks before what other views show are faded, views that fit are not; few views fade if one has wrong depth."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec import decode, encode
from fecocodec.coding.visibility import unpack_levels
from fecocodec.container import read_stream, write_stream
from fecocodec.evaluation.novel_views import render_views
from fecocodec.evaluation.stress.box_room import Room, painted, photograph, with_far_view
from fecocodec.geometry.cameras import Cameras, pixel_rays
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver import decode as receiver
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.fading import LEAST_VIEWS, Fading, fader, fading_of
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.sender.scene import Guides
from tests.example_scenes import MODEL, cameras_in_a_row, example_views, surface

DEPTH, SIDE, NUM_VIEWS = 1.5, 64, 5
FEW_STEPS = DEFAULT.with_steps(1)


@pytest.fixture(scope="module")
def cameras() -> Cameras:
    """Five cameras in a row, which look at a wall."""
    return cameras_in_a_row(*torch.linspace(-0.4, 0.4, NUM_VIEWS).tolist(), near=0.5, far=40.0)


def wall(cameras: Cameras, side: int) -> torch.Tensor:
    """Return the points on the wall at the pixels of each view: [view side side 3]."""
    return cameras.extrinsics[:, None, None, :3, 3] + pixel_rays(cameras, side, side) * DEPTH


@pytest.fixture(scope="module")
def photographs(cameras: Cameras) -> torch.Tensor:
    return painted(wall(cameras, SIDE)).permute(0, 3, 1, 2)


def gaussians_of(cameras: Cameras, depth: torch.Tensor | float = DEPTH) -> Gaussians:
    """Return one Gaussian for each 2x2 pixels, with the colour of the wall behind it."""
    side = SIDE // 2
    depths = torch.as_tensor(depth).expand(cameras.num_views, side, side)
    return surface(cameras, depths, painted(wall(cameras, side)), 0.9)


@pytest.fixture(scope="module")
def foggy(cameras: Cameras) -> Gaussians:
    """Gaussians on the wall, except for those of one block, which stand halfway before it."""
    depth = torch.full((NUM_VIEWS, SIDE // 2, SIDE // 2), DEPTH)
    depth[2, 8:16, 16:24] = 0.5 * DEPTH
    return gaussians_of(cameras, depth)


def test_a_block_in_front_of_the_wall_is_faded(cameras, photographs, foggy) -> None:
    fade = fader(photographs, cameras)
    clear, fogged = fade(gaussians_of(cameras), None), fade(foggy, None)
    assert fogged.levels.shape == (NUM_VIEWS, 4, 4)
    assert fogged.levels[2, 1, 2] == 3

    def faded(fading: Fading, gaussians: Gaussians) -> Gaussians:
        return replace(gaussians, opacities=gaussians.opacities * fading.factors(gaussians.count))

    def quality(gaussians: Gaussians) -> float:
        return float(psnr(render(gaussians, cameras, (SIDE, SIDE)).color, photographs).mean())

    assert quality(faded(fogged, foggy)) > quality(foggy) + 1.0
    assert quality(faded(clear, gaussians_of(cameras))) > quality(gaussians_of(cameras))


def test_a_second_search_continues_the_first(cameras, photographs, foggy) -> None:
    fade = fader(photographs, cameras)
    once = fade(foggy, None)
    before = once.logits.clone()
    twice = fade(foggy, once)
    assert torch.equal(once.logits, before)
    assert twice.logits[2, 1, 2] < once.logits[2, 1, 2]


def test_pixels_under_masks_are_not_compared(cameras, photographs, foggy) -> None:
    ignored = torch.zeros(NUM_VIEWS, SIDE, SIDE, dtype=torch.bool)
    ignored[0, :, 20:] = True
    spoiled = torch.where(ignored[:, None], 1.0 - photographs, photographs)
    found, expected, without = (
        fader(images, cameras, ignored=mask)(foggy, None).logits
        for images, mask in ((spoiled, ignored), (photographs, ignored), (spoiled, None))
    )
    assert torch.equal(found, expected) and not torch.equal(found, without)


def test_factors_are_those_that_a_decoder_applies(cameras) -> None:
    logits = torch.zeros(NUM_VIEWS, 4, 4)
    logits[3, 0, 1] = -20.0
    factors = Fading(logits).factors(gaussians_of(cameras).count).view(NUM_VIEWS, 32, 32)
    changed = factors != 1
    assert changed[3, :8, 8:16].all() and changed.sum() == 64
    assert (factors[3, :8, 8:16] == 0).all()
    assert fading_of(None) is None
    assert fading_of(Fading(torch.full((5, 4, 4), 2.0))) is None


def test_a_file_of_many_views_fades(random_weights: Path) -> None:
    model = random_weights / MODEL
    many = encode(example_views(LEAST_VIEWS), effort=FEW_STEPS, model=model)
    fading = read_stream(many).fading
    assert fading is not None and len(fading) == LEAST_VIEWS * 16 // 4
    faint, full = (decode(data, model=model, has_background=False) for data in (many, without_fading(many)))
    assert faint.gaussians.opacities.sum() < full.gaussians.opacities.sum()
    assert read_stream(encode(example_views(LEAST_VIEWS), effort="fast", model=model)).fading is None


def test_of_few_views_those_fade_that_nothing_confirms() -> None:
    """The depth of a view from the other end of a room is wrong: its Gaussians hide what the others show."""
    room, poses = Room(painted), with_far_view()
    far, fitting = photograph(room, poses, (96, 96)), photograph(room, poses[[0, 1, 3]], (96, 96))
    data = encode(far.select([0, 1, 2]), effort=FEW_STEPS)
    shown, hidden = (
        psnr(render_views(receiver.decode(file).gaussians, far), far.images).mean()
        for file in (data, without_fading(data))
    )
    assert shown > hidden + 0.1
    stream = read_stream(data)
    assert stream.fading is not None
    levels = unpack_levels(stream.fading, stream.header)
    assert not levels[:2].any() and levels[2].any()
    assert read_stream(encode(fitting, effort=FEW_STEPS)).fading is None
    assert read_stream(encode(far.select([0, 2]), effort=FEW_STEPS)).fading is None


def test_few_views_fade_only_if_the_photographs_gain_much(cameras, photographs, foggy) -> None:
    few = list(range(LEAST_VIEWS - 1))
    gaussians = foggy.keep(torch.arange(foggy.count) < len(few) * (SIDE // 2) ** 2)
    as_shown = render(gaussians, cameras.select(few), (SIDE, SIDE)).color
    nearly_so = torch.lerp(as_shown, photographs[few], 0.05)
    assert not fader(nearly_so, cameras.select(few))(gaussians, None).levels.any()
    assert fader(photographs[few], cameras.select(few))(gaussians, None).levels[2, 1, 2] > 0


def test_scenes_that_would_take_long_are_not_faded(random_weights: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fecocodec.sender.encode.MAX_PIXELS", LEAST_VIEWS * 64 * 64 - 1)
    data = encode(example_views(LEAST_VIEWS), effort=FEW_STEPS, model=random_weights / MODEL)
    assert read_stream(data).fading is None


def without_fading(data: bytes) -> bytes:
    return write_stream(replace(read_stream(data), fading=None))


def test_guides_show_what_hides_others(cameras, photographs, foggy) -> None:
    """Fog before the wall, which only a photograph that is not coded shows, is faded by that photograph."""
    beside = torch.tensor([0, 4])
    own = cameras.select(beside.tolist())
    of_views = foggy.count // NUM_VIEWS
    depth = torch.full((2, SIDE // 2, SIDE // 2), DEPTH)
    depth[0, 8:16, 24:32] = 0.5 * DEPTH
    fog = gaussians_of(own, depth)
    assert fog.count == 2 * of_views
    guides = Guides(photographs[2:3], cameras.select([2]))
    plain = fader(photographs[beside], own)(fog, None)
    guided = fader(photographs[beside], own, guides=guides)(fog, None)
    assert guided.logits[0, 1, 3] < plain.logits[0, 1, 3]
