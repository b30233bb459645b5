"""Extractors that are not ours, adapted: what is trained, what is stored, what is refused."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest
import torch
from torch import Tensor

import fecocodec
from fecocodec.checkpoint import DEFAULT_MODEL, RECEIVER_FILE, SENDER_FILE, SHIPPED
from fecocodec.config import ReceiverConfig
from fecocodec.container import quantise_lambda
from fecocodec.errors import ModelError
from fecocodec.geometry.cameras import Cameras
from fecocodec.receiver.model import load_receiver
from fecocodec.sender.codec import (
    Codec,
    adapted_sender,
    adopt_codec,
    load_adapted_sender,
    load_sender,
    serialise_sender,
)
from fecocodec.sender.encode import encode_with
from fecocodec.sender.extractors.adapter import AdaptedExtractor, LargeExtractor
from fecocodec.sender.model import Sender
from tests.chunk_files import write_wall_chunks
from tests.example_scenes import MODEL, example_cameras, example_views, fused

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "larger_extractor.py"


class Ramps:
    """Five channels a pixel: the colours, and how far right and down it is; `name` stands for its weights."""

    def __init__(self, name: str = "ramps", num_channels: int = 5) -> None:
        self.name, self.announced = name, num_channels

    def num_channels(self) -> int:
        return self.announced

    def features(self, images: Tensor, cameras: Cameras) -> Tensor:
        batch, views, _, h, w = images.shape
        right = torch.linspace(-1, 1, w).expand(batch, views, 1, h, w)
        down = torch.linspace(-1, 1, h)[:, None].expand(batch, views, 1, h, w)
        return torch.cat((images, right, down), dim=2)

    def fingerprint(self) -> str:
        return self.name


def is_decoded(sender: Sender, model: Path) -> bool:
    """Whether the receiver of a model decodes Gaussians from what the sender encodes."""
    receiver, model_id = load_receiver(model / RECEIVER_FILE)
    data = encode_with(Codec(sender, receiver, model_id), example_views(2), quantise_lambda(1e-3))
    return fecocodec.decode(data, model=model).gaussians.count > 0


@pytest.fixture
def example() -> ModuleType:
    specification = importlib.util.spec_from_file_location("larger_extractor", EXAMPLE)
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules["larger_extractor"] = module
    specification.loader.exec_module(module)
    return module


@pytest.fixture
def disk(example: ModuleType) -> LargeExtractor:
    kornia = pytest.importorskip("kornia.feature", reason="examples/larger_extractor.py needs kornia")
    torch.manual_seed(0)
    extractor: LargeExtractor = example.DiskExtractor(kornia.DISK())
    return extractor


def test_features_are_adapted_to_quarter_resolution_and_only_the_adapter_learns() -> None:
    extractor = AdaptedExtractor(Ramps(), 128)
    views = example_views(3, 64, 96)
    found = fused(extractor, views.images[None], views.cameras.as_batch())
    assert found.shape == (3, 128, 16, 24)
    found.square().mean().backward()
    assert all(parameter.grad is not None for parameter in extractor.parameters())
    assert {name.split(".")[0] for name, _ in extractor.named_parameters()} == {"input", "blocks"}
    assert len(extractor.blocks) == 3 and isinstance(Ramps(), LargeExtractor)


def test_an_adapted_sender_adopts_a_trained_codec_and_its_files_decode_with_that_receiver(
    random_weights: Path, tmp_path: Path
) -> None:
    receiver, model_id = load_receiver(random_weights / MODEL / RECEIVER_FILE)
    sender = adapted_sender(Ramps(), receiver.config)
    trained = load_sender(random_weights / MODEL / SENDER_FILE, receiver.config, model_id)
    adopt_codec(sender, trained)
    for name in ("analysis", "hyper_analysis", "feedback"):
        pairs = zip(getattr(sender, name).parameters(), getattr(trained, name).parameters(), strict=True)
        assert all(torch.equal(own, theirs) for own, theirs in pairs)

    (tmp_path / SENDER_FILE).write_bytes(serialise_sender(sender, model_id))
    loaded = load_adapted_sender(tmp_path / SENDER_FILE, Ramps(), receiver.config, model_id)
    assert is_decoded(loaded, random_weights / MODEL)


def test_refusals(random_weights: Path, tmp_path: Path) -> None:
    path = tmp_path / SENDER_FILE
    config, model_id = ReceiverConfig(), bytes(8)
    path.write_bytes(serialise_sender(adapted_sender(Ramps(), config), model_id))
    with pytest.raises(ModelError, match="was trained with the extractor ramps, not slopes"):
        load_adapted_sender(path, Ramps("slopes"), config, model_id)
    with pytest.raises(ModelError, match="made for the receiver 0000000000000000"):
        load_adapted_sender(path, Ramps(), config, bytes(range(8)))
    with pytest.raises(ModelError, match=r'in Python, as "Larger extractors" in docs/paper_profile\.md shows'):
        load_sender(path, config, model_id)
    with pytest.raises(
        ModelError, match=r"extractor ramps: gave features \(1, 2, 5, 64, 64\).*one vector of 7 channels"
    ):
        AdaptedExtractor(Ramps(num_channels=7), 128).match(example_views(2).images[None], example_cameras(2).as_batch())


def test_the_worked_example_fits(disk: LargeExtractor, random_weights: Path) -> None:
    assert isinstance(disk, LargeExtractor) and disk.fingerprint() == disk.fingerprint() and disk.num_channels() == 128
    assert is_decoded(adapted_sender(disk, ReceiverConfig()).eval(), random_weights / MODEL)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_worked_example_trains_a_sender_for_the_receiver_there_is(
    disk: LargeExtractor, example: ModuleType, tmp_path: Path
) -> None:
    """The shipped receiver, whose detail layer the trained networks lack."""
    model = SHIPPED / DEFAULT_MODEL
    scenes = write_wall_chunks(tmp_path / "scenes", num_scenes=2, num_frames=10)
    example.train_sender(disk, scenes, tmp_path / "out", minutes=1e-3, model=model)
    assert (tmp_path / "out" / RECEIVER_FILE).read_bytes() == (model / RECEIVER_FILE).read_bytes()
    receiver, model_id = load_receiver(model / RECEIVER_FILE)
    sender = load_adapted_sender(tmp_path / "out" / SENDER_FILE, disk, receiver.config, model_id)
    assert is_decoded(sender, model)
