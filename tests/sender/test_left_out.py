"""Coded views rendered without their own Gaussians: how well the views predict each other."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec import encode, measure_decoded, read_views
from fecocodec.geometry.views import Views
from fecocodec.sender.codec import Codec
from fecocodec.sender.decoded_quality import left_out_quality
from fecocodec.sender.view_quality import LeftOutQuality

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "motorcycle"
SIZE = (96, 128)


@pytest.fixture(scope="module")
def views() -> Views:
    return read_views(EXAMPLE, size=SIZE)


def left_out_of(codec: Codec, data: bytes, views: Views) -> LeftOutQuality:
    found = left_out_quality(codec.receiver, data, views)
    assert found is not None
    return found


def test_views_predict_each_other_unless_their_cameras_are_wrong(shipped_codec: Codec, views: Views) -> None:
    data = encode(views, effort="fast")
    left_out = left_out_of(shipped_codec, data, views)
    assert 17.0 < left_out.psnr < measure_decoded(data, views)[-1].psnr
    assert 0.5 < left_out.share <= 1.0
    swapped = replace(views, cameras=views.cameras.select([1, 0]))
    assert left_out_of(shipped_codec, encode(swapped, effort="fast"), swapped).psnr < left_out.psnr - 3.0


def test_cut_outs_are_measured_on_white_and_one_view_not_at_all(shipped_codec: Codec, views: Views) -> None:
    alpha = torch.zeros(2, *SIZE)
    alpha[:, 24:72, 32:96] = 1.0
    cut_out = replace(views, images=views.images * alpha[:, None] + 1.0 - alpha[:, None], alpha=alpha)
    data = encode(cut_out, effort="fast")
    on_white, on_black = (left_out_of(shipped_codec, data, one) for one in (cut_out, replace(cut_out, alpha=None)))
    assert on_white.psnr > on_black.psnr + 0.1
    alone = views.select([0])
    assert left_out_quality(shipped_codec.receiver, encode(alone, effort="fast"), alone) is None
