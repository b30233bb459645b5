"""Regression tests of defects that would degrade or stop the paper's training."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from fecosplat_cli.train import _default_minutes, _require_finished
from torch import Tensor

from fecocodec.config import PaperSenderConfig
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.sender.extractors.depthsplat_small.checkpoint import load_public_weights
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from fecocodec.training import training_pass
from fecocodec.training.batch_source import BatchesByStep, batches_from
from fecocodec.training.chunk_scenes import (
    DL3DV,
    LANES,
    REALESTATE10K,
    SAMPLES_OF_A_VISIT,
    ChunkScenes,
    choose_farthest_frames,
)
from fecocodec.training.configurations import Configuration, configuration_named
from fecocodec.training.loop import train
from fecocodec.training.optimisation import Schedule
from fecocodec.training.run_monitor import RunMonitor
from fecocodec.training.samples import Sample
from fecocodec.training.sources import Sources, open_sources
from fecocodec.training.training_pass import bypass_coding, run_stages
from tests.chunk_files import record, write_chunks, write_wall_chunks
from tests.example_scenes import example_views
from tests.sender.depthsplat_small.public_network import made_up_extractor
from tests.training.tiny_runs import SHAPES, changed, copied, synthetic_sources, tiny_trainer
from tests.wall_scene import shots

pytestmark = pytest.mark.usefixtures("one_thread")

TINY = Configuration(SHAPES, Schedule(4, photograph_share=(1.0, 1.0), warm_up=1, disparity_weight=(0.0, 0.0)))


def draw(scenes: ChunkScenes, seed: int = 0, num_target: int = 2) -> Sample:
    generator = torch.Generator().manual_seed(seed)
    return scenes.sample(generator, num_context=2, num_target=num_target, size=(64, 64))


def sources_with(photographs: ChunkScenes | None) -> Sources:
    return replace(synthetic_sources(), photographs=photographs)


@pytest.fixture(scope="module")
def extractor() -> DepthSplatSmall:
    return made_up_extractor()


# 1: crops


def test_all_frames_have_one_crop_under_the_public_geometry(tmp_path: Path) -> None:
    chunks = write_wall_chunks(tmp_path, num_scenes=1, num_frames=6)
    for protocol in (None, REALESTATE10K):
        configuration = replace(configuration_named("paper-re10k"), protocol=protocol)
        public = open_sources(chunks, None, configuration).photographs
        own = open_sources(chunks, None, replace(configuration, sender=PaperSenderConfig(geometry="exact"))).photographs
        assert isinstance(public, ChunkScenes) and isinstance(own, ChunkScenes)
        for seed in range(2):
            intrinsics = draw(public, seed).views.cameras.intrinsics
            assert torch.equal(intrinsics, intrinsics[:1].expand_as(intrinsics))
        if protocol is None:
            spread = draw(own).views.cameras.intrinsics
            assert not torch.equal(spread, spread[:1].expand_as(spread))


def test_views_of_different_intrinsics_are_matched_under_the_public_geometry(extractor: DepthSplatSmall) -> None:
    """As the bundled scene has them. Equal ones keep their bits, which the parity with the public network shows."""
    views = example_views(2)
    intrinsics = views.cameras.intrinsics.clone()
    intrinsics[1, 0, 2] += 0.05
    cameras = Cameras(views.cameras.extrinsics, intrinsics, views.cameras.near, views.cameras.far)
    same, other = (extractor.match(views.images[None], of.as_batch()) for of in (views.cameras, cameras))
    assert bool(other.cost.isfinite().all()) and not torch.equal(same.cost, other.cost)
    assert torch.equal(same.multi_view, other.multi_view)


# 2: time limit and unfinished runs


def test_the_papers_runs_have_no_time_limit_and_export_nothing_unfinished() -> None:
    assert _default_minutes(configuration_named("paper-re10k")) is None
    assert _default_minutes(configuration_named("compact")) == 60.0
    _require_finished(300_000, 300_000, Path("model"))
    with pytest.raises(InputError, match=r"model: nothing was exported, .* after 120 of 300000 steps; .*--steps 120"):
        _require_finished(120, 300_000, Path("model"))


# 3: averaged weights after resuming


def test_resuming_copies_into_the_averaged_weights_on_their_device(tmp_path: Path) -> None:
    """Whose values then are those of the checkpoint, see `test_loop.test_two_and_two_steps_are_four`."""
    it = tiny_trainer(tmp_path, TINY.schedule)
    it.save(it.checkpoint)
    before = {name: value.data_ptr() for name, value in it.average.items()}
    it.resume(it.checkpoint)
    assert {name: value.data_ptr() for name, value in it.average.items()} == before


# 4: matching of target views


def test_target_views_are_not_matched_for_a_loss_of_weight_zero(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    it = tiny_trainer(tmp_path / "run", TINY.schedule, sources_with(_chunks(tmp_path)))
    batch, _ = it.draw_batch()

    def refuse(*_: object) -> None:
        raise AssertionError("target views were matched")

    monkeypatch.setattr(training_pass, "with_targets", refuse)
    run_stages(it.sender, it.receiver, batch, bypass_coding, 1, None, 0.0)
    with pytest.raises(AssertionError, match="target views were matched"):
        run_stages(it.sender, it.receiver, batch, bypass_coding, 1, None, 0.5)


def _chunks(folder: Path) -> ChunkScenes:
    return ChunkScenes(write_wall_chunks(folder / "chunks", num_scenes=2, num_frames=6))


# 5: frames, scenes and chunks that cannot be used


def _partly_damaged(folder: Path) -> Path:
    """One good scene, one whose images are cut short, and a chunk that is missing."""
    good, cut = record("good", shots(6)), record("cut", shots(6))
    cut["images"] = [image[:40] for image in cut["images"]]
    root = write_chunks(folder, [[good, cut], [record("gone", shots(3))]])
    (root / "000001.torch").unlink()
    return root


def test_what_cannot_be_used_is_skipped_counted_and_logged(tmp_path: Path) -> None:
    it = tiny_trainer(tmp_path / "run", TINY.schedule, sources_with(ChunkScenes(_partly_damaged(tmp_path / "chunks"))))
    while it.num_bad_scenes < 12:
        it._report_skipped(it.draw_batch()[0])
    lines = (tmp_path / "run" / "bad_scenes_0.txt").read_text().splitlines()
    assert len(lines) == it.num_bad_scenes and it.counts["bad_scenes"] == len(lines)
    assert any("scene cut" in line for line in lines) and any("000001.torch: no such chunk" in line for line in lines)


def test_a_data_set_without_a_usable_scene_ends_the_run(tmp_path: Path) -> None:
    root = _partly_damaged(tmp_path)
    index = json.loads((root / "index.json").read_text())
    (root / "index.json").write_text(json.dumps({name: file for name, file in index.items() if name != "good"}))
    with pytest.raises(InputError, match="none of 100 scenes can be used; the last: "):
        draw(ChunkScenes(root))


# 6: worker processes


def test_workers_draw_what_the_process_itself_would(tmp_path: Path) -> None:
    dataset = BatchesByStep(sources_with(_chunks(tmp_path)), TINY, seed=3, rank=1, num_ranks=2)
    drawn = list(batches_from(dataset, 1, num_workers=2, device="cpu"))
    assert len(drawn) == 3
    for step, batch in enumerate(drawn, start=1):
        assert torch.equal(batch.images, dataset[step].images)  # type: ignore[union-attr]
    assert not torch.equal(drawn[0].images, drawn[1].images)


def test_an_error_in_a_worker_is_one_sentence(tmp_path: Path) -> None:
    short = ChunkScenes(write_wall_chunks(tmp_path, num_frames=2))
    dataset = BatchesByStep(Sources(short, short), TINY, seed=0, rank=0, num_ranks=1)
    with pytest.raises(InputError, match=r"^[^\n]*100 scenes have no more than 2 frames; ask for fewer\.$"):
        next(batches_from(dataset, 0, num_workers=1, device="cpu"))


def test_a_lane_stays_with_a_chunk_and_all_chunks_are_visited(tmp_path: Path) -> None:
    scenes = ChunkScenes(write_wall_chunks(tmp_path, num_scenes=20))  # ten chunks
    visited = [scenes.at_step(step, 0, 1)._names for step in range(LANES * SAMPLES_OF_A_VISIT * 5)]
    for lane in range(LANES):
        own = visited[lane::LANES]
        for visit in range(5):
            assert len(set(own[visit * SAMPLES_OF_A_VISIT : (visit + 1) * SAMPLES_OF_A_VISIT])) == 1
    assert len(set(visited)) == 10


# 8: validation and numbered checkpoints


def test_validation_scenes_are_measured_and_checkpoints_kept(tmp_path: Path) -> None:
    chunks = _chunks(tmp_path)
    sources = replace(synthetic_sources(), photographs=chunks, validation=chunks)
    settings = {"log_every": 2, "validation_scenes": 1, "keep_every": 1}
    schedule = replace(TINY.schedule, num_steps=2)
    it = tiny_trainer(tmp_path / "run", schedule, sources, settings=settings, lambda_range=(1e-3, 1e-3))
    weights = copied(it.networks)
    monitor = RunMonitor(it)
    first = monitor.validate()
    assert changed(it.networks, weights) == set()
    assert first == monitor.validate() and first["val_bpp"] > 0 and first["val_psnr"] > 3 and first["val_st_lpips"] > 0
    rows = list(train(it))
    assert [row["step"] for row in rows] == [2.0] and {"val_psnr", "val_st_lpips", "val_bpp"} <= rows[0].keys()
    assert {path.name for path in (tmp_path / "run").glob("step_*.pt")} == {"step_0000001.pt", "step_0000002.pt"}
    lines = (tmp_path / "run" / "validation.txt").read_text().splitlines()
    header, *values = (line.split("\t") for line in lines)
    assert header == ["step", "lmbda", "bpp", "psnr", "st_lpips"] and len(values) == 3
    last = dict(zip(header, map(float, values[-1]), strict=True))
    assert last["step"] == 2 and last["lmbda"] == pytest.approx(1e-3, rel=0.01)
    assert last["psnr"] == pytest.approx(rows[0]["val_psnr"], rel=1e-5)


# 9: the published checkpoint that has coarser features


def test_the_small_dl3dv_checkpoint_loads_with_a_warning(extractor: DepthSplatSmall, tmp_path: Path) -> None:
    tensors: dict[str, Tensor] = {f"encoder.depth_predictor.{k}": v for k, v in extractor.state_dict().items()}
    names = ("re10k-256x256-view2-cfeab6b1.pth", "re10kdl3dv-448x768-randview4-10-c08188db.pth")
    for name, warning in zip(names, ("", "features at 1/8 resolution"), strict=True):
        path = tmp_path / f"depthsplat-gs-small-{name}"
        torch.save(tensors, path)
        report = load_public_weights(extractor, path)
        path.unlink()
        assert warning in str(report) and bool(report.warning) == bool(warning)


# The data protocol of DepthSplat


def test_context_views_of_the_protocol() -> None:
    assert REALESTATE10K.gaps_at(0) == (25, 45) and REALESTATE10K.gaps_at(15_000) == (35, 90)
    assert REALESTATE10K.gaps_at(30_000) == REALESTATE10K.gaps_at(200_000) == (45, 135)
    assert DL3DV.gaps_at(0) == DL3DV.gaps_at(10) == (20, 50)
    centres = np.stack([np.linspace(0.0, 1.0, 200) ** 2, np.zeros(200), np.zeros(200)], axis=1)
    for seed in range(20):
        frames = choose_farthest_frames(np.random.default_rng(seed), centres, (40, 60), 4, 3)
        context, targets = frames[:4], frames[4:]
        assert 40 <= context[-1] - context[0] <= 60 and context == sorted(set(context))
        assert all(context[0] <= target <= context[-1] for target in targets)
        # Cameras accelerate, so the farthest point lies after the middle of the time.
        middle = (context[0] + context[-1]) / 2
        assert any(frame > middle for frame in context[1:3])


def test_frames_of_the_protocol_are_cropped_to_the_centre_and_not_tinted(tmp_path: Path) -> None:
    scenes = ChunkScenes(write_wall_chunks(tmp_path, num_scenes=1, num_frames=6), protocol=REALESTATE10K)
    samples = [draw(scenes, seed) for seed in range(8)]
    lenses = torch.stack([sample.views.cameras.intrinsics for sample in samples])
    assert torch.allclose(lenses[..., [0, 1], [0, 2]], lenses[0, 0, [0, 1], [0, 2]])
    first: dict[str, Tensor] = {}
    for sample in samples:
        for name, image in zip(sample.views.names, sample.views.images, strict=True):
            known = first.setdefault(name, image)
            assert torch.equal(image, known) or torch.equal(image.flip(-1), known)
