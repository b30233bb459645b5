"""Kept batches: the features are those that the frozen extractor gives, and a run with them leaves it as it is."""

from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
import torch

from fecocodec.config import SenderConfig
from fecocodec.errors import InputError
from fecocodec.training.batch import BatchShape
from fecocodec.training.batch_source import KeptBatches
from fecocodec.training.configurations import CONFIGURATIONS, RunSettings, configuration_named
from fecocodec.training.loop import train
from fecocodec.training.optimisation import Schedule
from fecocodec.training.sources import draw_batch
from fecocodec.training.trainer import Trainer
from fecocodec.training.training_pass import extract
from tests.training.tiny_runs import SHAPES, changed, copied, synthetic_batch, synthetic_sources, tiny_trainer

pytestmark = pytest.mark.usefixtures("one_thread")
SHAPE = BatchShape(num_scenes=1, num_context=2, num_target=1, size=(64, 64))


@pytest.fixture(scope="module")
def it(one_thread: None, tmp_path_factory: pytest.TempPathFactory) -> Trainer:
    """A trainer that keeps two batches of 64x64 pixels."""
    schedule = Schedule(3, one_stage_until=0, bypass_until=0, warm_up=1)
    return tiny_trainer(tmp_path_factory.mktemp("kept"), schedule, frozen=("extractor",), kept_batches=2)


def loss_with_kept_features_and_without(trainer: Trainer) -> dict[str, float]:
    """Both must be equal; return the parts of the loss."""
    batch = synthetic_batch(seed=1)
    losses = []
    for known in (extract(trainer.sender, trainer.receiver, True, batch), None):
        torch.manual_seed(2)  # of the noise in place of rounding
        loss, parts = trainer._loss(batch, known)
        losses.append(loss.detach())
    torch.testing.assert_close(*losses)
    return parts


def test_kept_features_give_the_loss_of_features_computed_anew(it: Trainer, tmp_path: Path) -> None:
    assert {"bpp1", "bpp2", "disparity2"} <= loss_with_kept_features_and_without(it).keys()
    paper = configuration_named("ablate-iterations-3")
    configuration = replace(
        paper, shapes=SHAPES, sender=SenderConfig(), precision="float32", frozen=("extractor",), kept_batches=2
    )
    trainer = Trainer(RunSettings(tmp_path, configuration, 5.0), synthetic_sources())
    assert {"bpp1", "bpp2", "bpp3"} <= loss_with_kept_features_and_without(trainer).keys()


def test_batches_that_were_added_are_taken_in_an_order_that_the_generator_alone_decides(it: Trainer) -> None:
    def draw():
        raise AssertionError("with a fresh share of 0, a kept batch is taken")

    orders = []
    for _ in range(2):
        kept, generator = KeptBatches(3, (0, 1768), fresh_share=0.0), torch.Generator().manual_seed(5)
        for seed in range(3):
            batch = synthetic_batch(seed=seed)
            kept.add(SHAPE, batch, extract(it.sender, it.receiver, True, batch))
        taken = [
            kept.take(SHAPE, generator, draw, partial(extract, it.sender, it.receiver, True))[0] for _ in range(12)
        ]
        orders.append([(float(one.images.sum()), int(one.lambda_q)) for one in taken])
    assert orders[0] == orders[1]
    assert len({picture for picture, _ in orders[0]}) == 3


def test_a_batch_is_used_again_with_another_lambda_until_newer_ones_replace_it(it: Trainer) -> None:
    kept, generator, drawn = KeptBatches(2, (0, 1768)), torch.Generator().manual_seed(3), []

    def draw():
        drawn.append(draw_batch(it.sources, generator, SHAPE, 0.0))
        return drawn[-1]

    taken = [kept.take(SHAPE, generator, draw, partial(extract, it.sender, it.receiver, True))[0] for _ in range(24)]
    assert len(kept) == 2 < len(drawn) < len(taken)
    again = [one for one, next_one in pairwise(taken) if torch.equal(one.images, next_one.images)]
    assert again and len({int(one.lambda_q) for one in taken}) > len(drawn)
    torch.testing.assert_close(taken[0].images, drawn[0].images, atol=1e-3, rtol=0)


def test_a_run_with_kept_batches_trains_all_but_what_is_frozen(it: Trainer, tmp_path: Path) -> None:
    before = copied(it.networks)
    list(train(it))
    moved = changed(it.networks, before)
    assert any(name.startswith("receiver.") for name in moved) and any("analysis" in name for name in moved)
    assert not any(name.startswith("sender.extractor.") for name in moved)
    configuration = replace(it.settings.configuration, frozen=("matching",))
    trainer = Trainer(replace(it.settings, folder=tmp_path / "run", configuration=configuration), it.sources)
    before = copied(trainer.networks)
    extracted = trainer.draw_batch()[1]
    assert extracted is not None and extracted.features is None
    list(train(trainer))
    moved = changed(trainer.networks, before)
    of_extractor = {name.split(".")[2] for name in moved if name.startswith("sender.extractor.")}
    assert {"input", "fine_in", "coarse", "output"} <= of_extractor
    assert not of_extractor & {"stem", "down_stem", "cross_view", "up_attended", "matching_head", "log_temperature"}
    with pytest.raises(InputError, match=r"only while the extractor or its matching is frozen; add one of them"):
        replace(CONFIGURATIONS["compact"], kept_batches=10)
