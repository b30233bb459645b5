"""Streams whose second stage leaves views out, and streams that say which Gaussians to emit."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec.coding.kept_cells import bits_to_cells, cells_to_bits, is_in_kept_cell
from fecocodec.container import Keep, Stream, read_prefix, read_stream, write_stream
from fecocodec.receiver.decode import decode
from fecocodec.receiver.view_states import update_views
from fecocodec.sender.encode import assemble, code_stages, load_profile
from fecocodec.sender.steps import PreparedScene, Profile, match_views, prepare
from tests.example_scenes import MODEL, example_views

VIEWS, HEIGHT, WIDTH = 3, 70, 101
ROWS, COLUMNS = 35, 51  # of the 1/2 grid
LAMBDA_Q = 900


@pytest.fixture(scope="module")
def profile(random_weights: Path) -> Profile:
    return load_profile(random_weights / MODEL, "cpu")


@pytest.fixture(scope="module")
def scene(profile: Profile) -> PreparedScene:
    with torch.no_grad():
        return prepare(profile, example_views(VIEWS, HEIGHT, WIDTH))


def encoded(profile: Profile, scene: PreparedScene, stage_2_views: tuple[int, ...] | None, keep: Keep | None) -> bytes:
    with torch.no_grad():
        matched = match_views(profile, scene)
        stages = code_stages(profile, scene, matched, LAMBDA_Q, 2, stage_2_views=stage_2_views)
        return assemble(profile, scene, stages, keep)


@pytest.fixture(scope="module")
def whole(profile: Profile, scene: PreparedScene) -> bytes:
    return encoded(profile, scene, None, None)


@pytest.mark.parametrize("chosen", [(0,), (2,), (0, 2), (0, 1, 2)])
def test_a_view_is_coded_a_second_time_only_where_it_is_chosen(
    profile: Profile, scene: PreparedScene, whole: bytes, random_weights: Path, chosen: tuple[int, ...]
) -> None:
    data = encoded(profile, scene, chosen, None)
    stream = read_stream(data)
    assert stream.header.stage_2_views == chosen
    assert stream.payloads[0] == read_stream(whole).payloads[0]
    share = len(stream.payloads[1]) / len(read_stream(whole).payloads[1])
    assert abs(share - len(chosen) / VIEWS) < 0.1
    assert decode(data, model=random_weights / MODEL).gaussians.count == VIEWS * ROWS * COLUMNS


@pytest.mark.parametrize("chosen", [(1,), (0, 2)])
def test_views_left_out_keep_state_and_condition(profile: Profile, chosen: tuple[int, ...]) -> None:
    generator = torch.Generator().manual_seed(0)
    latents = torch.randn(2, VIEWS, profile.receiver.config.latent_channels, 4, 4, generator=generator)
    lambda_q = torch.full((VIEWS,), LAMBDA_Q)
    every = tuple(range(VIEWS))
    first = update_views(profile.receiver, None, latents[0], lambda_q, 1, every)
    whole = update_views(profile.receiver, first, latents[1], lambda_q, 2, every)
    some = update_views(profile.receiver, first, latents[1][list(chosen)], lambda_q, 2, chosen)
    for view in every:
        expected = whole if view in chosen else first
        torch.testing.assert_close(some.state[view], expected.state[view])
        torch.testing.assert_close(some.condition.embedding[view], expected.condition.embedding[view])
    assert not torch.allclose(first.state, whole.state, atol=1e-2)


def test_the_first_stage_does_not_know_which_views_follow(
    profile: Profile, scene: PreparedScene, whole: bytes, random_weights: Path
) -> None:
    some = encoded(profile, scene, (1,), None)
    first, second = (decode(data, stages=1, model=random_weights / MODEL).gaussians for data in (whole, some))
    assert all(torch.equal(a, b) for a, b in zip(first.fields(), second.fields(), strict=True))


def with_keep(data: bytes, keep: Keep) -> bytes:
    stream = read_stream(data)
    return write_stream(Stream(stream.header, stream.cameras, stream.payloads, keep=keep))


def test_cells_that_are_not_kept_emit_nothing(whole: bytes, random_weights: Path) -> None:
    kept = torch.rand(VIEWS, 9, 13, generator=torch.Generator().manual_seed(1)) < 0.5
    every = decode(whole, model=random_weights / MODEL).gaussians
    some = decode(with_keep(whole, Keep(0, cells_to_bits(kept))), model=random_weights / MODEL).gaussians
    at_pixel = kept.repeat_interleave(4, 1).repeat_interleave(4, 2)[:, :ROWS, :COLUMNS]
    assert torch.equal(some.means, every.means[at_pixel.flatten()])
    assert 0 < some.count < every.count


def test_gaussians_below_the_threshold_are_not_emitted(whole: bytes, random_weights: Path) -> None:
    every = decode(whole, model=random_weights / MODEL).gaussians
    threshold = round(255 * float(every.opacities.median()))
    some = decode(with_keep(whole, Keep(threshold)), model=random_weights / MODEL).gaussians
    assert torch.equal(some.opacities, every.opacities[every.opacities >= threshold / 255])
    assert 0 < some.count < every.count


def test_what_to_keep_is_said_of_the_whole_stream(whole: bytes, random_weights: Path) -> None:
    data = with_keep(whole, Keep(255, bytes(44)))
    assert decode(data, model=random_weights / MODEL).gaussians.count == 0
    assert decode(data, stages=2, model=random_weights / MODEL).gaussians.count == VIEWS * ROWS * COLUMNS
    assert read_prefix(data, 2).keep is None


def test_cells_survive_as_bits(whole: bytes) -> None:
    header = replace(read_stream(whole).header, height=64, width=72)
    cells = torch.rand(VIEWS, 8, 9, generator=torch.Generator().manual_seed(2)) < 0.3
    bits = cells_to_bits(cells)
    assert len(bits) == 27
    assert torch.equal(bits_to_cells(bits, header), cells)
    assert int(is_in_kept_cell(Keep(0, bits), header)[: 32 * 48].sum()) == 16 * int(cells[0].sum()) + 32 * 12
