"""The trainer: steps, checkpoints, log, exact resumption."""

import csv
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
import torch.distributed as dist

from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE
from fecocodec.errors import InputError, ModelError, OutputError
from fecocodec.sender.codec import load_codec
from fecocodec.training import optimisation
from fecocodec.training import trainer as trainer_module
from fecocodec.training.batch import Batch
from fecocodec.training.loop import train
from fecocodec.training.model_weights import export_model
from fecocodec.training.optimisation import Schedule, SkippedSteps
from fecocodec.training.run_files import append_row, load_checkpoint, mean_of_rows, remove_rows_after, save_checkpoint
from fecocodec.training.trainer import Trainer
from tests.example_scenes import MODEL
from tests.training.tiny_runs import changed, copied, tiny_trainer

pytestmark = pytest.mark.usefixtures("one_thread")


def trainer(folder: Path, num_steps: int = 4, seed: int = 0, samples_every_minutes: float = math.inf) -> Trainer:
    """Two steps of warm-up (one with a single stage), then the rate."""
    schedule = Schedule(num_steps, one_stage_until=1, bypass_until=2, warm_up=1)
    settings = {"seed": seed, "log_every": 2, "samples_every_minutes": samples_every_minutes}
    return tiny_trainer(folder, schedule, settings=settings)


@pytest.fixture(scope="module")
def finished(one_thread: None, tmp_path_factory: pytest.TempPathFactory) -> Trainer:
    """Four steps in one go, the first of which shows sample pictures."""
    it = trainer(tmp_path_factory.mktemp("finished") / "run", samples_every_minutes=1e3)
    it.rows = list(train(it))  # type: ignore[attr-defined]
    return it


def test_a_run_logs_finite_losses_and_leaves_one_whole_checkpoint(finished: Trainer) -> None:
    rows = finished.rows  # type: ignore[attr-defined]
    assert [row["step"] for row in rows] == [2.0, 4.0]
    assert all(torch.isfinite(torch.tensor(list(row.values()))).all() for row in rows)
    assert rows[0]["bpp1"] == 0.0 and rows[1]["bpp1"] > 0.0  # the warm-up codes nothing
    folder = finished.settings.folder
    assert sorted(path.name for path in folder.iterdir()) == ["last.pt", "log.csv", "samples"]
    assert [path.name for path in (folder / "samples").iterdir()] == ["step_000001.png"]
    assert len((folder / "log.csv").read_text().splitlines()) == 3


def test_two_and_two_steps_are_four(finished: Trainer, tmp_path: Path) -> None:
    first = trainer(tmp_path)
    for _ in range(2):
        first.train_step()
    first.save(tmp_path / "middle.pt")
    second = trainer(tmp_path, seed=7)  # nothing of its own start may remain
    second.resume(tmp_path / "middle.pt")
    assert len(list(train(second))) == 1
    assert second.step == 4
    assert changed(second.networks, copied(finished.networks)) == set()
    assert all(torch.equal(value, finished.average[name]) for name, value in second.average.items())


def test_a_group_of_one_trains_exactly_like_a_process_on_its_own(tmp_path: Path) -> None:
    """Averaging gradients must keep their layout in memory: the fused optimiser relies on it."""
    alone = trainer(tmp_path / "alone")
    alone.train_step()
    store = f"file://{tmp_path / 'store'}"
    dist.init_process_group("gloo", init_method=store, rank=0, world_size=1)
    try:
        grouped = trainer(tmp_path / "grouped")
        grouped.train_step()
    finally:
        dist.destroy_process_group()
    assert changed(alone.networks, copied(grouped.networks)) == set()


def test_an_exported_checkpoint_is_a_model_that_loads(finished: Trainer, tmp_path: Path) -> None:
    export_model(finished.checkpoint, tmp_path / "model", finished.settings.configuration)
    codec = load_codec(tmp_path / "model", "cpu")
    average = finished.average["receiver.predictor.depth_head.weight"]
    torch.testing.assert_close(codec.receiver.predictor.depth_head.weight, average, atol=1e-3, rtol=1e-3)
    prior = finished.average["receiver.prior.hyper_prior.weight"]
    torch.testing.assert_close(codec.receiver.prior.hyper_prior.weight, prior, atol=2.0**-12, rtol=0)


def test_a_stop_while_saving_leaves_the_old_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "last.pt"
    save_checkpoint(path, {"step": 1})
    with pytest.raises(ModelError, match="not a checkpoint of these networks"):
        trainer(tmp_path).resume(path)
    with pytest.raises(OutputError, match=r"missing/last\.pt: the checkpoint cannot be written"):
        save_checkpoint(tmp_path / "missing" / "last.pt", {"step": 1})

    def stopped(contents: object, file: Path) -> None:
        Path(file).write_bytes(b"half of it")
        raise KeyboardInterrupt

    monkeypatch.setattr(torch, "save", stopped)
    with pytest.raises(KeyboardInterrupt):
        save_checkpoint(path, {"step": 2})
    assert load_checkpoint(path) == {"step": 1}


def test_the_schedule_warms_up_decays_and_moves_its_shares() -> None:
    schedule = Schedule(1000, one_stage_until=10, bypass_until=20, learning_rate=1e-3, warm_up=100)
    assert schedule.learning_rate_at(0) == pytest.approx(1e-5, rel=1e-3)
    assert 0.0 < schedule.learning_rate_at(999) < 1e-8
    rates = [schedule.learning_rate_at(step) for step in range(100, 1001)]
    assert rates == sorted(rates, reverse=True)
    assert schedule.photograph_share_at(0) == 0.4 and schedule.photograph_share_at(2000) == pytest.approx(0.6)


def test_rows_of_the_log(tmp_path: Path) -> None:
    append_row(tmp_path / "log.csv", mean_of_rows([{"loss": 1.0}, {"loss": 3.0, "bpp1": 0.5}]) | {"step": 2.0})
    append_row(tmp_path / "log.csv", {"step": 4.0, "loss": 0.25})
    first, second = csv.DictReader((tmp_path / "log.csv").read_text().splitlines())
    assert (first["loss"], first["bpp1"], second["loss"], second["bpp1"]) == ("2", "0.5", "0.25", "")
    path = tmp_path / "resumed.csv"
    for step in (50.0, 100.0, 150.0):
        append_row(path, {"step": step, "loss": 1.0})
    remove_rows_after(path, 100)
    assert [row.split(",")[0] for row in path.read_text().splitlines()] == ["step", "50", "100"]
    remove_rows_after(tmp_path / "none.csv", 100)
    assert not (tmp_path / "none.csv").exists()


@pytest.mark.parametrize(("num_steps", "max_minutes"), [(4, 1e-9), (1, 5.0)])
def test_a_run_that_is_out_of_time_or_short_logs_and_saves(tmp_path: Path, num_steps: int, max_minutes: float) -> None:
    it = trainer(tmp_path, num_steps)
    it.settings = replace(it.settings, max_minutes=max_minutes, log_every=1000)
    assert [row["step"] for row in train(it)] == [1.0]
    assert load_checkpoint(it.checkpoint)["step"] == 1
    assert len(it.log.read_text().splitlines()) == 2


def test_a_skipped_batch_is_counted_and_spoils_no_mean(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    it = trainer(tmp_path, num_steps=2)
    real = trainer_module.loss_of

    def broken_once(batch: Batch, *others: Any) -> tuple[torch.Tensor, dict[str, float]]:
        loss, parts = real(batch, *others)
        return (loss * float("nan"), parts | {"mse1": float("nan")}) if it.step == 1 else (loss, parts)

    monkeypatch.setattr(trainer_module, "loss_of", broken_once)
    (row,) = train(it)
    assert row["skipped"] == 1.0 and all(math.isfinite(value) for value in row.values())
    assert all(bool(value.isfinite().all()) for value in it.networks.state_dict().values())


def test_a_run_that_diverges_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps without finite gradients change nothing."""
    monkeypatch.setattr(optimisation, "MOST_SKIPPED", 2)
    it = trainer(tmp_path)
    before = copied(it.networks)
    it.sender.extractor.log_temperature.register_hook(lambda gradient: gradient * float("nan"))
    sentence = "the gradients of 2 successive steps were not finite; train in another folder with a sm"
    with pytest.raises(InputError, match=sentence):
        list(train(it))
    assert (it.step, it.skipped.num) == (1, 2) and not it.checkpoint.exists()
    assert changed(it.networks, before) == set()


def test_only_successive_skipped_steps_end_a_run() -> None:
    skipped = SkippedSteps()
    taken = [skipped.is_taken(norm) for norm in [*[math.nan] * 9, 1.0, *[math.inf] * 9]]
    assert taken.count(True) == 1 and skipped.num == 18
    with pytest.raises(InputError, match="10 successive steps"):
        skipped.is_taken(math.nan)


def test_weights_that_are_not_finite_are_not_exported(finished: Trainer, tmp_path: Path) -> None:
    saved = load_checkpoint(finished.checkpoint)
    saved["average"]["receiver.prior.hyper_prior.weight"][:] = math.nan  # integers in the file, where NaN cannot be
    save_checkpoint(tmp_path / "last.pt", saved)
    with pytest.raises(ModelError, match=r"last\.pt: its weights are not finite; train in another"):
        export_model(tmp_path / "last.pt", tmp_path / "model", finished.settings.configuration)
    assert not (tmp_path / "model").exists()


def test_starting_from_a_model_and_exporting_gives_the_model_again(random_weights: Path, tmp_path: Path) -> None:
    it = trainer(tmp_path / "run")
    it.start_from(random_weights / MODEL)
    it.save(it.checkpoint)
    export_model(it.checkpoint, tmp_path / "again", it.settings.configuration)
    for name in (RECEIVER_FILE, SENDER_FILE):
        assert (tmp_path / "again" / name).read_bytes() == (random_weights / MODEL / name).read_bytes()
