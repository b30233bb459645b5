"""The paper's configurations on tiny data sets: two processes under torchrun, and a public checkpoint to begin with."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fecocodec.training.configurations import CONFIGURATIONS, configuration_named
from fecocodec.training.run_files import load_checkpoint
from tests.chunk_files import record, write_chunks, write_wall_chunks
from tests.wall_scene import shots

ROOT = Path(__file__).resolve().parents[2]


def write_dl3dv(folder: Path) -> Path:
    wall = record("", shots(10), url="1f0e06e4388dd600")
    return write_chunks(folder, [[wall | {"key": f"capture{number}"} for number in range(2)]])


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("name", "write", "num_views"), [
    ("paper-re10k", write_wall_chunks, "2"),
    ("paper-dl3dv", write_dl3dv, "4"),
])  # fmt: skip
def test_twenty_steps_on_two_processes(name: str, write, num_views: str, tmp_path: Path) -> None:
    """Four views instead of eight: the fewest that are matched by the nearest cameras."""
    chunks, run = write(tmp_path / "chunks"), tmp_path / "run"
    command = [
        sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2",
        "-m", "fecosplat_cli", "train", str(run), "--config", name, "--photographs", str(chunks),
        "--steps", "20", "--views", num_views, "--size", "64x64",
        "--targets", "1", "--threads", "1", "--max-minutes", "8",
    ]  # fmt: skip
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    result = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[-3000:]
    saved = load_checkpoint(run / "last.pt")
    assert saved["step"] == 20 and saved["num_skipped"] == 0 and len(saved["generators"]) == 2
    assert all(bool(value.isfinite().all()) for value in saved["average"].values())


def test_the_configurations_are_the_papers_and_variants_differ_as_named() -> None:
    re10k, dl3dv = configuration_named("paper-re10k"), configuration_named("paper-dl3dv")
    for name in ("paper-re10k", "paper-dl3dv", "paper-dl3dv-large"):
        configuration = configuration_named(name)
        assert (configuration.schedule.learning_rate, configuration.precision) == (2e-4, "bfloat16")
        assert configuration.shapes.num_scenes == 1
    assert re10k.schedule.num_steps == dl3dv.schedule.num_steps == 300_000
    assert re10k.sender.extractor == dl3dv.sender.extractor == "depthsplat-small"
    assert re10k.lambda_range == pytest.approx((1e-5, 1e-2)) and dl3dv.lambda_range == pytest.approx((1e-5, 1e-3))
    assert re10k.shapes.sizes == ((256, 256),) and dl3dv.shapes.sizes == ((256, 448),)
    assert dl3dv.shapes.view_shares == ((8, 1.0),)
    assert dl3dv.receiver.lambda_range == pytest.approx((1e-5, 1e-3))
    base = configuration_named("ablate-iterations-2")
    assert base == configuration_named("ablate-gaussians-half") and base.schedule.num_steps == 100_000
    for name, value in (("quarter", 1), ("half", 2), ("full", 4)):
        assert configuration_named(f"ablate-gaussians-{name}").receiver.gaussians_per_side == value
    assert [configuration_named(f"ablate-iterations-{n}").receiver.num_stages for n in (1, 2, 3)] == [1, 2, 3]
    for part in ("no-context", "no-feedback"):
        assert configuration_named(f"ablate-{part}").sender.ablation == part
    large = configuration_named("paper-dl3dv-large")
    assert large.sender.extractor == "depthsplat-base" and large.schedule.num_steps == 150_000


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", [name for name in CONFIGURATIONS if name.startswith("ablate-")])
def test_every_ablation_trains_exports_and_is_measured(name: str, tmp_path: Path) -> None:
    """Twenty steps on tiny data, as the command line runs them."""
    chunks, run, model = write_wall_chunks(tmp_path / "chunks", num_frames=4), tmp_path / "run", tmp_path / "model"
    index = tmp_path / "index.json"
    index.write_text(json.dumps({"wall0": {"context": [0, 3], "target": [1]}}))
    commands = [
        ["train", run, "--config", name, "--photographs", chunks, "--validation", chunks, "--validate-every", "10",
         "--steps", "20", "--size", "64x64", "--targets", "1", "--precision", "float32", "--export", model],
        ["eval", chunks, "--index", index, "-o", tmp_path / "out", "--model", model, "--size", "64x64",
         "--lambdas", "1e-3", "--no-strips"],
    ]  # fmt: skip
    for command in commands:
        result = subprocess.run(
            [sys.executable, "-m", "fecosplat_cli", *map(str, command), "--threads", "1"],
            cwd=ROOT, capture_output=True, text=True,
        )  # fmt: skip
        assert result.returncode == 0, result.stderr[-3000:]
    header, *rows = (tmp_path / "out" / "summary.tsv").read_text().splitlines()
    systems = [row.split("\t")[0] for row in rows]
    estimated = ["fecosplat, 3 stages, estimated rate"] if name == "ablate-iterations-3" else []
    assert systems == ["fecosplat", *estimated] and header.startswith("system")
    assert "val_psnr" in (run / "log.csv").read_text().splitlines()[0]
