"""From a trained compact model to the paper's extractor and back, one receiver for both."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

import fecocodec
from benchmarks.small_ablations import start_variant_from
from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE
from fecocodec.config import PAPER, PAPER_RECEIVER, CodecConfig, PaperSenderConfig, ReceiverConfig, SenderConfig
from fecocodec.errors import InputError, ModelError
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.model import Receiver
from fecocodec.sender.codec import load_codec
from fecocodec.sender.model import Sender
from fecocodec.training.chunk_scenes import ChunkScenes
from fecocodec.training.model_weights import export_model, load_model_weights
from fecocodec.training.optimisation import Schedule
from fecocodec.training.run_files import save_checkpoint
from fecocodec.training.sources import Sources
from fecocodec.training.trainer import Trainer
from tests.chunk_files import write_wall_chunks
from tests.example_scenes import MODEL, example_views
from tests.sender.depthsplat_small.public_network import undrawn
from tests.training.tiny_runs import changed, copied, synthetic_sources, tiny_trainer

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Sources:
    folder = write_wall_chunks(tmp_path_factory.mktemp("chunks"), num_scenes=2)
    return replace(synthetic_sources(), photographs=ChunkScenes(folder, spread=0.0))


def trainer(folder: Path, sources: Sources, sender: CodecConfig, frozen: tuple[str, ...] = ()) -> Trainer:
    schedule = Schedule(4, photograph_share=(1.0, 1.0), disparity_weight=(0.0, 0.0), warm_up=1, learning_rate=1e-4)
    return tiny_trainer(folder, schedule, sources, sender=sender, frozen=frozen)


def exported(it: Trainer, folder: Path) -> Path:
    save_checkpoint(it.checkpoint, {"average": it.average})  # without the optimiser's state, which is twice as much
    export_model(it.checkpoint, folder, it.settings.configuration)
    return folder


def decoded_by(model: Path, data: bytes) -> Gaussians:
    return Gaussians.of(fecocodec.decode(data, model=model).gaussians)


def test_files_of_both_senders_decode_with_the_receiver_that_was_frozen(
    sources: Sources, random_weights: Path, tmp_path: Path
) -> None:
    compact = random_weights / MODEL
    it = trainer(tmp_path / "run", sources, PaperSenderConfig(), frozen=("receiver",))
    it.start_from(compact)
    before = it.sender.extractor.regressor[0]["4"].weight.clone()
    rows = [it.train_step() for _ in range(2)]
    assert it.skipped.num == 0 and all(row["gradient"] > 0 for row in rows)
    assert not torch.equal(it.sender.extractor.regressor[0]["4"].weight, before)

    paper = exported(it, tmp_path / "weights" / "paper")
    assert (paper / RECEIVER_FILE).read_bytes() == (compact / RECEIVER_FILE).read_bytes()
    views = example_views(2)
    with undrawn():
        loaded = load_codec(paper, "cpu")
        by_compact, by_paper = (fecocodec.encode(views, effort="fast", model=model) for model in (compact, paper))
    assert loaded.model_id == load_codec(compact, "cpu").model_id and loaded.sender.config == PaperSenderConfig()
    assert by_compact != by_paper
    for data in (by_compact, by_paper):
        first, second = decoded_by(compact, data), decoded_by(paper, data)
        assert first.count > 0 and torch.equal(first.means, second.means)

    # Back, to the compact extractor of the model before it.
    back = trainer(tmp_path / "back", sources, SenderConfig(), frozen=("receiver",))
    back.start_from(paper)
    report = back.start_extractor_from(compact)
    assert report.missing == () and len(report.used) == len(back.sender.extractor.state_dict())
    assert changed(back.sender.extractor, copied(load_codec(compact, "cpu").sender.extractor)) == set()
    again = exported(back, tmp_path / "weights" / "compact")
    assert load_codec(again, "cpu").model_id == loaded.model_id


@pytest.mark.parametrize(
    ("config", "reason"),
    [(PAPER_RECEIVER, "method compact, not paper"), (ReceiverConfig(synthesis_depth=3), "synthesis_depth 2, not 3")],
)
def test_a_model_of_other_networks_is_refused_with_what_differs(
    random_weights: Path, config: ReceiverConfig, reason: str
) -> None:
    with pytest.raises(ModelError, match=f"{MODEL}: the model was made with {reason}; name another model, or choose"):
        load_model_weights(Sender(SenderConfig(), config), Receiver(config), random_weights / MODEL)


def test_refusals(sources: Sources, random_weights: Path, tmp_path: Path) -> None:
    compact = trainer(tmp_path / "run", sources, SenderConfig())
    with pytest.raises(ModelError, match="public checkpoints are for depthsplat-small; name the folder of a model"):
        compact.start_extractor_from(tmp_path / "depthsplat.pth")
    with undrawn():
        paper = trainer(tmp_path / "other", sources, PaperSenderConfig())
    with pytest.raises(ModelError, match="its extractor is compact, this run's is depthsplat-small"):
        paper.start_extractor_from(random_weights / MODEL)
    configuration = replace(compact.settings.configuration, frozen=("tail",))
    with pytest.raises(InputError, match="There is no part 'tail' to freeze; choose from receiver, extractor"):
        Trainer(replace(compact.settings, configuration=configuration), sources)


def test_a_paper_sender_is_not_taken_for_a_compact_one(random_weights: Path, tmp_path: Path) -> None:
    for name in (RECEIVER_FILE, SENDER_FILE):
        (tmp_path / name).write_bytes((random_weights / MODEL / name).read_bytes())
    data = (tmp_path / SENDER_FILE).read_bytes()
    (tmp_path / SENDER_FILE).write_bytes(
        data.replace(b'\\"extractor\\": \\"compact\\"', b'\\"extractor\\": \\"unknown\\"')
    )
    with pytest.raises(ModelError, match="its extractor 'unknown' is not known to this version"):
        load_codec(tmp_path, "cpu")


def test_a_variant_takes_the_weights_that_fit(sources: Sources, random_weights: Path, tmp_path: Path) -> None:
    """Another number of Gaussians and the feedback of the paper have layers of other shapes; one more starts anew."""
    it = trainer(tmp_path / "run", sources, SenderConfig())
    paper = ReceiverConfig(method=PAPER, gaussians_per_side=4)
    variant = Trainer(replace(it.settings, configuration=replace(it.settings.configuration, receiver=paper)), sources)
    before = copied(variant.networks)
    it.start_from(random_weights / MODEL)
    started = start_variant_from(variant, random_weights / MODEL, ("receiver.predictor.depth_head",))
    layers = ("receiver.predictor.depth_head", "receiver.predictor.head.2")
    assert set(started) == {"sender.feedback.input.weight", *(f"{layer}.{part}" for layer in layers for part in (
        "weight", "bias",
    ))}  # fmt: skip
    usual = it.networks.state_dict()
    for name, value in variant.networks.state_dict().items():
        assert torch.equal(value, before[name] if name in started else usual[name])
        assert torch.equal(value, variant.average[name])
