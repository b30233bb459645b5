"""Ignored pixels are filled with the colours around them, and no other pixel changes."""

import torch

from fecocodec.geometry.coding_grid import filled


def hole() -> torch.Tensor:
    ignored = torch.zeros(2, 20, 30, dtype=torch.bool)
    ignored[0, 5:15, 0:12] = True
    return ignored


def test_a_hole_gets_the_colours_around_it() -> None:
    across = torch.linspace(0.2, 0.8, 30).expand(2, 3, 20, 30)
    spoiled = torch.where(hole()[:, None], 1.0, across)
    found = filled(spoiled, hole())
    assert float((found - across).abs()[0, :, 6:14, 4:10].max()) < 0.15
    assert torch.equal(torch.where(hole()[:, None], 0.0, found), torch.where(hole()[:, None], 0.0, across))


def test_what_was_under_the_mask_does_not_matter() -> None:
    images = torch.rand(2, 3, 20, 30, generator=torch.Generator().manual_seed(0))
    assert torch.equal(filled(images, hole()), filled(torch.where(hole()[:, None], 0.5, images), hole()))


def test_without_masks_images_are_returned_as_they_are() -> None:
    images = torch.rand(2, 3, 20, 30)
    assert filled(images, None) is images and filled(images, torch.zeros(2, 20, 30, dtype=torch.bool)) is images


def test_an_image_of_which_nothing_is_kept_is_black() -> None:
    ignored = torch.ones(1, 20, 30, dtype=torch.bool)
    assert torch.equal(filled(torch.rand(1, 3, 20, 30), ignored), torch.zeros(1, 3, 20, 30))
