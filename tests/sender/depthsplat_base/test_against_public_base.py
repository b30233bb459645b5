"""Tensor by tensor and number by number the public DepthSplat-Base, up to its features at full resolution."""

import numpy as np
import pytest
import torch
from public_base_network import CHANNEL_STEPS, SHAPES, SHIPPED, made_up_network

from fecocodec.errors import InputError, ModelError
from fecocodec.geometry.cameras import Cameras
from fecocodec.sender.extractors.adapter import LargeExtractor
from fecocodec.sender.extractors.depthsplat_base.extractor import DepthSplatBase
from tests.example_scenes import example_views
from tests.sender.depthsplat_small.public_network import require_near, undrawn, views_of


@pytest.fixture(scope="module")
def network() -> DepthSplatBase:
    return made_up_network()


def test_tensors_have_the_public_names_and_shapes(network: DepthSplatBase) -> None:
    assert {name: list(value.shape) for name, value in network.state_dict().items()} == SHAPES


@torch.inference_mode()
def test_every_part_gives_the_public_numbers(network: DepthSplatBase) -> None:
    arrays = dict(np.load(SHIPPED))
    images, cameras = views_of(arrays)
    maps, predictor = network.maps(images, cameras), network.depth_predictor
    monocular, (depth, probabilities) = predictor.monocular(maps), predictor.depth(maps, cameras)
    found = {"depth": depth[:, None], "features": network.features(images, cameras)[0]}
    for scale in (0, 1):
        found[f"features_cnn_{scale}"] = maps.appearance[2 - scale]
        found[f"features_mv_{scale}"] = maps.multi_view[scale]
        found[f"features_mono_{scale}"] = monocular[scale]
        found[f"match_prob_{scale}"] = probabilities[scale]
    assert found.keys() == CHANNEL_STEPS.keys()
    step = int(arrays["position_step"])
    for name, value in found.items():
        kept = value[:, :: CHANNEL_STEPS[name], ::step, ::step]
        require_near(kept[:, 0] if name == "depth" else kept, arrays[name], name)


@torch.inference_mode()
def test_one_view_and_scenes_of_a_batch(network: DepthSplatBase) -> None:
    """A single view is its own source, and has no matching scores; scenes of a batch do not mix."""
    alone = example_views(1, 64, 96)
    maps = network.maps(alone.images[None], alone.cameras.as_batch())
    depth, _ = network.depth_predictor.depth(maps, alone.cameras.as_batch())
    assert depth.shape == (1, 64, 96) and bool(depth.isfinite().all())
    views = example_views(3, 64, 96)
    first, second = views.images[None], views.images.flip(-1)[None]
    cameras = views.cameras.as_batch()
    both = Cameras(*(torch.cat((value, value)) for value in (
        cameras.extrinsics, cameras.intrinsics, cameras.near, cameras.far,
    )))  # fmt: skip
    found = network.features(torch.cat((first, second)), both)
    assert found.shape == (2, 3, 96, 64, 96)
    torch.testing.assert_close(found[1:], network.features(second, cameras), atol=1e-4, rtol=1e-4)


def test_it_is_an_extractor_of_the_adapter_and_refuses_what_it_cannot_do(network: DepthSplatBase) -> None:
    assert isinstance(network, LargeExtractor) and network.num_channels() == 96
    views = example_views(2, 64, 72)
    with pytest.raises(InputError, match="images of 72x64 pixels: pad to multiples of 16"):
        network.features(views.images[None], views.cameras.as_batch())
    unloaded = "it has no weights yet; load its checkpoint by `load_frozen_extractor`"
    with undrawn(), pytest.raises(ModelError, match=unloaded):
        DepthSplatBase().features(views.images[None], views.cameras.as_batch())
