"""Photographs of different exposure and white balance are made alike; what hardly differs is left as it is."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from fecocodec.codec.encode_folder import encode_folder
from fecocodec.codec.options import EncodingOptions
from fecocodec.evaluation.stress.box_room import Room, along_a_line, painted, photograph
from fecocodec.geometry.sparse_matches import corners_of
from fecocodec.geometry.views import Views
from fecocodec.sender.exposure import exposure_factors, with_factors
from tests.example_scenes import write_views

FACTORS = torch.tensor([[1.3, 1.3, 1.3], [1.0, 1.0, 0.7], [0.6, 0.6, 0.6], [1.2, 0.9, 1.0]])


@pytest.fixture(scope="module")
def views() -> Views:
    """Four photographs of one exposure, without dark or bright places."""
    room = photograph(Room(painted), along_a_line(3), (96, 96))
    return replace(room, images=0.2 + 0.5 * room.images)


def factors_of(*parts: Views) -> tuple[Tensor, ...] | None:
    return exposure_factors(parts, [found for part in parts for found in corners_of(part.images, part.ignored)])


def test_neighbours_get_their_mean_exposure(views: Views) -> None:
    changed = with_factors(views, FACTORS)
    factors = torch.cat(factors_of(changed.select([0, 1, 2]), changed.select([3])))
    torch.testing.assert_close(factors.log().mean(dim=0), torch.zeros(3), atol=1e-5, rtol=0)
    undone = factors * FACTORS
    torch.testing.assert_close(undone, undone.mean(dim=0).expand(4, 3), atol=0.03, rtol=0)


def test_what_changes_slowly_along_a_walk_hardly_changes() -> None:
    walk = photograph(Room(painted), along_a_line(11)[:-1], (96, 96))
    walk = replace(walk, images=0.2 + 0.5 * walk.images)
    drift = torch.linspace(-0.2, 0.2, 11).exp()[:, None].expand(11, 3)
    (factors,) = factors_of(with_factors(walk, drift))
    assert float(factors[3:8].log().abs().max()) < 0.03  # at the ends, neighbours are on one side


def test_one_exposure_stays(views: Views) -> None:
    assert factors_of(views) is None
    assert factors_of(views.select([0])) is None


def test_masked_pixels_do_not_count(views: Views) -> None:
    ignored = torch.zeros(4, 96, 96, dtype=torch.bool)
    ignored[1, :, 40:] = True
    spoiled = views.images.clone()
    spoiled[1, :, :, 40:] *= 0.5
    assert factors_of(replace(views, images=spoiled, ignored=ignored)) is None
    assert factors_of(replace(views, images=spoiled)) is not None


def test_the_white_of_cut_outs_stays(views: Views) -> None:
    alpha = torch.zeros(4, 96, 96)
    alpha[:, 20:60, 20:60] = 1.0
    cut_out = replace(views, images=torch.where(alpha[:, None] > 0, views.images, 1.0), alpha=alpha)
    darker = with_factors(cut_out, torch.full((4, 3), 0.5)).images
    assert (darker[:, :, :10] == 1.0).all()
    torch.testing.assert_close(darker[:, :, 20:60, 20:60], 0.5 * views.images[:, :, 20:60, 20:60])


@pytest.mark.usefixtures("found_once")
def test_a_folder_is_encoded_with_one_exposure_and_that_is_said(views: Views, tmp_path: Path) -> None:
    """Coded photographs are compared with what was coded; those of one exposure get no note."""
    quality = {}
    for name, factors in (("equal", torch.ones(4, 3)), ("unequal", FACTORS)):
        write_views(tmp_path / name, with_factors(views, factors))
        report = encode_folder(tmp_path / name, EncodingOptions(effort="fast", num_stages=1))
        quality[name] = report.quality[-1].psnr
        is_said = any(note.startswith("exposures or white balances differ by up to ") for note in report.notes)
        assert is_said == (name == "unequal")
    assert quality["unequal"] > quality["equal"] - 1.0
