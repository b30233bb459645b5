"""The sender's networks do not depend on the order of views; their latents and sizes are bounded."""

import pytest
import torch

from fecocodec.checkpoint import model_folder
from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.layers.blocks import RateEmbedding
from fecocodec.sender.codec import load_codec
from fecocodec.sender.model import Sender
from fecocodec.sender.parameters import parameter_table
from tests.example_scenes import example_views, fused


@pytest.fixture(scope="module")
def sender() -> Sender:
    torch.manual_seed(0)
    return Sender(SenderConfig(), ReceiverConfig()).eval().requires_grad_(False)


def test_views_and_scenes_are_independent(sender: Sender) -> None:
    views = example_views(4)
    order = [2, 0, 3, 1]
    cameras, _ = normalise_scene(views.cameras)
    features = fused(sender.extractor, views.images[None], cameras.as_batch())
    permuted = fused(sender.extractor, views.images[None, order], cameras.select(order).as_batch())
    torch.testing.assert_close(permuted, features[order], atol=1e-4, rtol=1e-4)
    scenes = [example_views(2, seed=seed) for seed in (1, 2)]
    batches = [normalise_scene(scene.cameras)[0].as_batch() for scene in scenes]
    alone = [fused(sender.extractor, s.images[None], c) for s, c in zip(scenes, batches, strict=True)]
    joined = type(batches[0])(*(torch.cat(parts) for parts in zip(*(c.fields() for c in batches), strict=True)))
    together = fused(sender.extractor, torch.stack([scene.images for scene in scenes]), joined)
    torch.testing.assert_close(together, torch.cat(alone), atol=1e-4, rtol=1e-4)


@torch.no_grad()
def test_wild_features_give_latents_that_can_be_coded(sender: Sender) -> None:
    features, condition = torch.randn(1, 128, 16, 16) * 1e6, RateEmbedding(1768, 11.0, 0.5)(torch.tensor([0]), 1)
    y = sender.analysis(features, features, condition)
    z = sender.hyper_analysis(y)
    assert bool(y.isfinite().all() and z.isfinite().all())
    assert float(y.abs().max()) <= 2.0**15 and float(z.abs().max()) <= 2.0**15


def test_numbers_of_parameters_are_what_was_promised() -> None:
    table, receiver = parameter_table(), load_codec(model_folder(None), "cpu").receiver
    totals = {row.module.split(",")[0]: row.parameters for row in table if row.side == "sum"}
    assert "steps" in {row.module for row in table}  # what ships proposes its steps
    assert totals["receiver"] == pytest.approx(3.45e6, rel=0.01)
    assert totals["receiver"] == sum(parameter.numel() for parameter in receiver.parameters())
    assert totals["sender"] <= 12e6
    assert sum(row.parameters for row in table if row.side == "receiver") == totals["receiver"]
    assert sum(row.parameters for row in table if row.side != "sum") == totals["sender"]
