"""The entropy model alone: fewer bits, and nothing else changes."""

from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec.coding.payload import encode_latents
from fecocodec.config import PAPER
from fecocodec.errors import InputError
from fecocodec.receiver.model import serialise_receiver
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.lambda_roles import stage_lambdas
from fecocodec.sender.optimisation_config import FAST
from fecocodec.training.model_weights import write_model
from fecocodec.training.optimisation import Schedule
from fecocodec.training.train_entropy import ENTROPY, SceneLatents, draw_latents, latents_of, train_entropy_model
from tests.training.tiny_runs import SHAPES, changed, copied, synthetic_sources, tiny_trainer

pytestmark = pytest.mark.usefixtures("one_thread")

SOURCES = synthetic_sources()
SHORT = replace(ENTROPY, shapes=SHAPES, schedule=replace(ENTROPY.schedule, num_steps=15, learning_rate=1.6e-2))


@pytest.fixture(autouse=True)
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fecocodec.training.train_entropy.DEFAULT", FAST)


@pytest.fixture(scope="module")
def untrained(tmp_path_factory: pytest.TempPathFactory) -> Codec:
    """Networks as training starts with them: a block transform, whose prior has learnt nothing."""
    trainer = tiny_trainer(tmp_path_factory.mktemp("run"), Schedule(1), SOURCES)
    return Codec(trainer.sender, trainer.receiver, b"")


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def bytes_of(codec: Codec, scenes: list[SceneLatents]) -> int:
    """Of real payloads, both stages."""
    prior, total = codec.receiver.prior, 0
    with torch.no_grad():
        for scene in scenes:
            lambdas = stage_lambdas(torch.tensor([scene.lambda_q]), len(scene.y))
            for stage, (y, lambda_q) in enumerate(zip(scene.y, lambdas, strict=True), start=1):
                context = None if stage == 1 else scene.y1_hat
                z = codec.sender.hyper_analysis(y)
                total += len(encode_latents(prior, y, z, int(lambda_q), stage, context)[0])
    return total


def test_bytes_fall_on_other_scenes_and_the_other_networks_stay(untrained: Codec, tmp_path: Path) -> None:
    codec = deepcopy(untrained)
    others = draw_latents(codec, SOURCES, SHORT, generator(), 2)
    before = bytes_of(codec, others)
    rows = list(train_entropy_model(codec, SOURCES, SHORT, seed=1, num_scenes=2))
    assert [(row["step"], row["skipped"]) for row in rows] == [(15.0, 0.0)]
    assert rows[0]["bpp1"] > 0 and rows[0]["bpp2"] > 0
    assert bytes_of(codec, others) < 0.9 * before
    learned = changed(codec.receiver, copied(untrained.receiver)), changed(codec.sender, copied(untrained.sender))
    for names, part in zip(learned, ("prior.", "hyper_analysis."), strict=True):
        assert names and all(name.startswith(part) for name in names)
    assert not any(parameter.requires_grad for parameter in codec.receiver.parameters())

    write_model(tmp_path / "model", serialise_receiver(codec.receiver), codec.sender)
    load_codec(tmp_path / "model", "cpu")


def test_latents_are_those_of_the_sender_at_every_lambda(untrained: Codec) -> None:
    sample = SOURCES.synthetic.sample(generator(), num_context=2, num_target=1, size=(64, 64))
    views = sample.views.select([0, 1])
    fine, coarse, alone = latents_of(untrained, views, (200, 1700, 200), num_alone=1)
    assert fine.y[0].shape == fine.y[1].shape == fine.y1_hat.shape == (2, 32, 8, 8)
    assert float(fine.y[0].std()) > 3 * float(coarse.y[0].std())  # finer steps at lower lambda
    assert not fine.y[0].requires_grad
    assert len(alone.y) == 1 and alone.y1_hat is None
    assert float(alone.y[0].std()) > 1.5 * float(fine.y[0].std())  # the first of two stages is coarser


def test_latents_that_are_drawn(untrained: Codec) -> None:
    assert ENTROPY.alone_every == 8
    scenes = draw_latents(untrained, SOURCES, replace(SHORT, alone_every=2), generator(), 2)
    assert [len(scene.y) for scene in scenes] == [2, 2, 2, 1]
    first, again = (draw_latents(untrained, SOURCES, SHORT, generator(), 1) for _ in range(2))
    assert all(torch.equal(a.y[0], b.y[0]) and a.lambda_q == b.lambda_q for a, b in zip(first, again, strict=True))


def test_a_model_of_the_paper_is_refused(untrained: Codec) -> None:
    codec = deepcopy(untrained)
    codec.receiver.config = replace(codec.receiver.config, method=PAPER)
    with pytest.raises(InputError, match="has the paper's method, which trains all networks together; train it as"):
        next(train_entropy_model(codec, SOURCES, SHORT))
