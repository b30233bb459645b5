"""Coded views rendered without their own Gaussians: how well the views predict each other."""

from dataclasses import replace
from pathlib import Path

import torch

from fecocodec import encode, measure_decoded, read_views
from fecocodec.sender.decoded_quality import measure_left_out

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "motorcycle"


def test_views_predict_each_other_unless_their_cameras_are_wrong() -> None:
    views = read_views(EXAMPLE, size=(96, 128))
    data = encode(views, effort="fast")
    left_out = measure_left_out(data, views)
    assert left_out is not None and 17.0 < left_out.psnr < measure_decoded(data, views)[-1].psnr
    assert 0.5 < left_out.share <= 1.0
    swapped = replace(views, cameras=views.cameras.select([1, 0]))
    wrong = measure_left_out(encode(swapped, effort="fast"), swapped)
    assert wrong is not None and wrong.psnr < left_out.psnr - 3.0


def test_cut_outs_are_measured_on_white_and_one_view_not_at_all() -> None:
    views = read_views(EXAMPLE, size=(96, 128))
    alpha = torch.zeros(2, 96, 128)
    alpha[:, 24:72, 32:96] = 1.0
    cut_out = replace(views, images=views.images * alpha[:, None] + 1.0 - alpha[:, None], alpha=alpha)
    data = encode(cut_out, effort="fast")
    on_white, on_black = measure_left_out(data, cut_out), measure_left_out(data, replace(cut_out, alpha=None))
    assert on_white is not None and on_black is not None and on_white.psnr > on_black.psnr + 0.1
    views = read_views(EXAMPLE, size=(64, 96)).select([0])
    assert measure_left_out(encode(views, effort="fast"), views) is None
