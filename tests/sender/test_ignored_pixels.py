"""Pixels that masks mark: nothing of them reaches the file, and nothing is compared with them."""

from dataclasses import replace

import pytest
import torch

from fecocodec import InputError, encode, measure_decoded
from fecocodec.coding.visibility import unpack_levels
from fecocodec.container import read_stream
from fecocodec.evaluation.novel_views import render_views
from fecocodec.evaluation.stress.box_room import Room, look, painted, photograph, waves
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode
from fecocodec.rendering.metrics import psnr
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encoder_of, matched_scene
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.sender.references import References
from fecocodec.sender.scene import prepare_scene

SIZE = (64, 96)
FEW_STEPS = DEFAULT.with_steps(1)
ROWS, COLUMNS = slice(8, 64), slice(32, 68)
POSES = torch.stack([look((step, 0.05 * step, -1.5)) for step in (-0.4, 0.0, 0.4, -0.2, 0.2)])
NAMES = ("left.png", "middle.png", "right.png", "a.png", "b.png")


@pytest.fixture(scope="module")
def room() -> Views:
    """Three photographs to code, and two between them."""
    return replace(photograph(Room(painted), POSES, SIZE), names=NAMES)


def with_passer_by(views: Views, view: int, seed: int = 9) -> Views:
    """A part of another room in a view, and a mask on it."""
    other = photograph(Room(lambda points: waves(points, seed)), POSES[:1], SIZE).images[0].flip(-2)
    images, ignored = views.images.clone(), torch.zeros(len(views.images), *SIZE, dtype=torch.bool)
    images[view, :, ROWS, COLUMNS], ignored[view, ROWS, COLUMNS] = other[:, ROWS, COLUMNS], True
    return replace(views, images=images, ignored=ignored)


@pytest.fixture(scope="module")
def masked(room: Views) -> Views:
    return with_passer_by(room.select([0, 1, 2]), 1)


def without_mask(views: Views) -> Views:
    return replace(views, ignored=None)


def test_what_is_under_a_mask_does_not_change_the_file(room: Views, masked: Views) -> None:
    other = with_passer_by(room.select([0, 1, 2]), 1, seed=4)
    guides = [with_passer_by(room.select([3, 4]), 0, seed) for seed in (9, 4)]
    assert not torch.equal(masked.images, other.images) and not torch.equal(guides[0].images, guides[1].images)
    small = [views.select([0, 1]) for views in (masked, other)]
    files = [encode(views, guides=of, effort=FEW_STEPS) for views, of in zip(small, guides, strict=True)]
    assert files[0] == files[1]
    assert encode(without_mask(small[0]), guides=guides[0], effort=FEW_STEPS) != files[0]
    qualities = [measure_decoded(files[0], views) for views in small]
    assert qualities[0] == qualities[1] != measure_decoded(files[0], without_mask(small[0]))


def test_a_wall_behind_a_masked_passer_by_is_not_punished(room: Views, masked: Views) -> None:
    def at_new_views(views: Views) -> float:
        gaussians = decode(encode(views, effort="fast")).gaussians
        return float(psnr(render_views(gaussians, room.select([3, 4])), room.images[3:]).mean())

    with_mask, without = at_new_views(masked), at_new_views(without_mask(masked))
    assert with_mask > without + 1.0
    assert with_mask > at_new_views(room.select([0, 1, 2])) - 1.5


def test_blocks_under_a_mask_have_no_gaussians(masked: Views) -> None:
    stream = read_stream(encode(masked.select([0, 1]), effort="fast"))
    assert stream.fading is not None
    levels = torch.from_numpy(unpack_levels(stream.fading, stream.header))
    expected = torch.zeros(2, 4, 6, dtype=torch.uint8)
    expected[1, 1:, 2:4] = 3  # the blocks of 16x16 pixels within the mask
    assert torch.equal(levels, expected)
    assert encode(masked.select([0]), effort="fast") == encode(without_mask(masked).select([0]), effort="fast")


def test_masked_pixels_confirm_nothing(shipped_codec: Codec, room: Views, masked: Views) -> None:
    pairs = (masked.select([0, 1]), without_mask(masked).select([0, 1]))
    found, plain = (
        matched_scene(shipped_codec, views, None, lambda _: None)[0].matching.depth.consistency for views in pairs
    )
    assert float(found[1, :, 2:, 8:17].max()) == 0.0 < float(plain[1, :, 2:, 8:17].max())
    assert int((found[0] < 0.01).sum()) > int((plain[0] < 0.01).sum())  # of what the middle one alone could confirm
    guided = matched_scene(shipped_codec, masked.select([1]), room.select([3, 4]), lambda _: None)[0].matching.depth
    assert float(guided.consistency[0, :, 2:, 8:17].max()) == 0.0 < float(guided.consistency.mean())


def test_renderings_equal_the_photographs_under_masks(shipped_codec: Codec, room: Views, masked: Views) -> None:
    guides = with_passer_by(room.select([3, 4]), 1)
    references = References.of(encoder_of(shipped_codec, prepare_scene(masked, shipped_codec.device, guides)))
    nothing = Gaussians(torch.zeros(0, 3), torch.zeros(0, 3), torch.zeros(0, 4), torch.zeros(0), torch.zeros(0, 1, 3))
    for part in (references, references.taught(1)):
        assert part.ignored is not None and part.ignored.shape[0] == 5
        is_equal = (part.rendered(nothing) == part.pictures).all(dim=1)
        assert torch.equal(is_equal, part.ignored)


def test_a_guide_is_judged_by_what_no_mask_marks(shipped_codec: Codec, room: Views) -> None:
    guides = room.select([3, 4])
    ignored = torch.zeros(2, *SIZE, dtype=torch.bool)
    ignored[0, :, :72] = True
    images = torch.where(ignored[:, None], torch.rand(2, 3, *SIZE), guides.images)
    said: list[str] = []
    spoiled = replace(guides, images=images, ignored=ignored)
    _, scene = matched_scene(shipped_codec, room.select([0, 2]), spoiled, said.append)
    assert said == [] and scene.guides is not None and scene.guides.count == 2
    nothing = replace(spoiled, ignored=torch.ones(2, *SIZE, dtype=torch.bool))
    _, scene = matched_scene(shipped_codec, room.select([0, 2]), nothing, said.append)
    assert scene.guides is None and all("hardly any point" in sentence for sentence in said)


def test_a_mask_on_everything_is_refused(masked: Views) -> None:
    nothing = replace(masked, ignored=torch.ones(3, *SIZE, dtype=torch.bool))
    with pytest.raises(InputError, match=r"a mask marks every pixel of left\.png; leave it out by `views`"):
        encode(nothing)
