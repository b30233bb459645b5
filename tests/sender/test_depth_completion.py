"""Depth completion: it begins as the blended disparity, and its senders load and save."""

from pathlib import Path

import torch

from fecocodec.checkpoint import DEFAULT_MODEL, SENDER_FILE, SHIPPED, read_weights
from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.receiver.model import Receiver
from fecocodec.sender.extractors.depth_completion import DepthCompletion, MatchedMaps
from fecocodec.sender.extractors.dinov2 import FEATURES
from fecocodec.sender.load import load_sender, serialise_sender
from fecocodec.sender.model import Sender
from fecocodec.training.fine_tuning import load_model_weights

MOST_PARAMETERS = 31_000_000  # of the sender, with DINOv2's 22.06 million


def drawn_maps(height: int, width: int) -> MatchedMaps:
    generator = torch.Generator().manual_seed(6)
    return MatchedMaps(*(torch.rand(2, 1, height, width, generator=generator) for _ in range(4)))


def completed(completion: DepthCompletion, maps: MatchedMaps) -> torch.Tensor:
    height, width = (4 * side for side in maps.disparity.shape[-2:])
    generator = torch.Generator().manual_seed(7)
    images = torch.rand(2, 3, height, width, generator=generator)
    with torch.no_grad():
        return completion(maps, images, torch.randn(2, FEATURES, 5, 9, generator=generator))


def test_it_begins_with_matched_disparity_where_it_is_consistent_and_planes_elsewhere() -> None:
    maps = drawn_maps(16, 24)
    expected = maps.consistency * maps.disparity + (1.0 - maps.consistency) * maps.extrapolated
    torch.testing.assert_close(completed(DepthCompletion(), maps), expected)


def test_corrections_of_the_patches_leave_consistent_disparity_alone() -> None:
    completion, maps = DepthCompletion(), drawn_maps(16, 24)
    torch.nn.init.constant_(completion.coarse.bias, 0.3)
    found = completed(completion, maps)
    sure = maps.consistency > 0.99
    assert (found - maps.blended).abs()[sure].max() < 0.01
    unsure = (maps.consistency < 0.2) & (maps.blended < 0.6)
    assert ((found - maps.blended)[unsure] > 0.2).all()


def test_results_stay_in_range() -> None:
    completion = DepthCompletion()
    torch.nn.init.constant_(completion.output.bias, 5.0)
    assert torch.equal(completed(completion, drawn_maps(16, 16)), torch.ones(2, 1, 16, 16))


def test_a_sender_with_completion_survives_its_file_and_is_small_enough(tmp_path: Path) -> None:
    sender = Sender(SenderConfig(is_monocular=True), ReceiverConfig())
    assert sum(p.numel() for p in sender.parameters()) + 22_060_000 < MOST_PARAMETERS
    path = tmp_path / "sender.safetensors"
    path.write_bytes(serialise_sender(sender, b"12345678"))
    loaded = load_sender(path, ReceiverConfig(), b"12345678")
    assert loaded.extractor.completion is not None


def test_training_with_completion_can_start_from_a_model_without_it() -> None:
    sender, receiver = Sender(SenderConfig(is_monocular=True), ReceiverConfig()), Receiver(ReceiverConfig())
    before = sender.extractor.completion.token.weight.clone()
    model = SHIPPED / DEFAULT_MODEL
    load_model_weights(sender, receiver, model)
    assert torch.equal(sender.extractor.completion.token.weight, before)
    tensors = read_weights(model / SENDER_FILE).tensors
    assert torch.equal(sender.extractor.input.weight, tensors["extractor.input.weight"])
