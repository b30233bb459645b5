"""`fecosplat batch`: options, reports, exit codes, and files that equal those of the single commands."""

import json
from pathlib import Path

import pytest
from fecosplat_cli import batch_options

from fecocodec.batch import run

FAST = ("--effort", "fast", "--views", "0,1", "--stages", "1")


@pytest.fixture
def scenes(photographs: Path, tmp_path: Path) -> Path:
    """A folder with two scenes, of which the second has no cameras and no photographs."""
    root = tmp_path / "scenes"
    (root / "empty").mkdir(parents=True)
    (root / "wall").symlink_to(photographs)
    return root


def test_files_equal_those_of_encode_and_decode(fecosplat, networks, scenes: Path, tmp_path: Path) -> None:
    coded, single = tmp_path / "coded", tmp_path / "single.fcs"
    result = fecosplat(
        "batch", "encode", scenes, "-o", coded, "--shard", "1/1", *FAST, "--measure", "--title", "A wall"
    )
    assert (result.code, result.out) == (1, "")
    assert result.err.startswith(f"empty failed: {scenes / 'empty'}: no photographs and no camera file found; ")
    assert f"{coded}: 1 done, 0 skipped, 1 failed in " in result.err
    details = json.loads((coded / "wall.fcs.json").read_text())["details"]
    again = fecosplat("encode", scenes / "wall", "-o", single, *FAST, "--title", "A wall", "--json")
    assert details["context_psnr"] == json.loads(again.out)["context_psnr"]
    assert details["views"] == ["view_0.png", "view_1.png"]
    assert (coded / "wall.fcs").read_bytes() == single.read_bytes()

    splats = tmp_path / "splats"
    result = fecosplat("batch", "decode", coded, "-o", splats, "--shard", "1/1", "--sh-degree", "0", "--json")
    assert (result.code, result.err) == (0, "")
    fields = json.loads(result.out)
    assert {name: fields[name] for name in ("scenes", "done", "skipped", "failed")} == {
        "scenes": 1, "done": 1, "skipped": 0, "failed": 0,
    }  # fmt: skip
    assert fecosplat("decode", single, "-o", tmp_path / "single.ply", "--sh-degree", "0").code == 0
    assert (splats / "wall.ply").read_bytes() == (tmp_path / "single.ply").read_bytes()
    assert fields["bytes"] == len((splats / "wall.ply").read_bytes())


def test_a_batch_is_as_strict_as_encode(fecosplat, networks, scenes, output, monkeypatch) -> None:
    """Nothing but the decoded quality is wrong here; a batch once did not measure it."""
    for name in ("quality_warnings", "left_out_warnings"):
        monkeypatch.setattr(f"fecocodec.codec.encode_folder.{name}", lambda *_arguments, **_options: ())
    monkeypatch.setattr("fecocodec.sender.encode.overlap_warnings", lambda *_arguments: ())
    strict = (*FAST, "--guides", "none", "--strict")
    assert fecosplat("encode", scenes / "wall", "-o", output / "single.fcs", *strict).code == 0
    batch = ("batch", "encode", scenes, "-o", output, "--shard", "2/2", *strict)
    assert fecosplat(*batch).code == 0 and fecosplat(*batch[:-1], "--overwrite").code == 0
    assert (output / "wall.fcs").read_bytes() == (output / "single.fcs").read_bytes()  # --strict changes no byte
    sentence = "the decoded views are poor"
    monkeypatch.setattr(
        "fecocodec.codec.encode_folder.quality_warnings", lambda *_arguments, **_options: (f"{sentence}.",)
    )
    refused = fecosplat("encode", scenes / "wall", "-o", output / "single.fcs", *strict, "--overwrite")
    assert fecosplat(*batch).code == refused.code == 1  # what was encoded without --strict does not count
    error = f"{scenes / 'wall'}: {sentence} (--strict makes this warning an error)."
    assert refused.err.splitlines()[-1] == f"fecosplat: {error}"
    sidecar = json.loads((output / "wall.fcs.json").read_text())
    assert (sidecar["error"], sidecar["traceback"], sidecar["warnings"]) == (error, None, [])


def test_a_second_run_skips_and_the_summary_says_so(fecosplat, networks, scenes: Path, output: Path) -> None:
    """--verbose prints each scene with throughput, -q failures alone."""
    arguments = ("batch", "encode", scenes, "-o", output, "--shard", "1/1", *FAST)
    result = fecosplat(*arguments, "--verbose")
    assert " s   50%  empty failed; 1 of 2 scenes, " in result.err
    assert " s  100%  wall done; 2 of 2 scenes, " in result.err
    assert " a minute, 0 s left\n" in result.err and "1 done, 0 skipped, 1 failed" in result.err
    assert "0 done, 1 skipped, 1 failed" in fecosplat(*arguments).err
    assert rows_of_summary(output) == [["scene", "status"], ["empty", "failed"], ["wall", "skipped"]]
    result = fecosplat(*arguments, "--lambda", "1e-2", "-q")
    assert (result.code, result.out, result.err.count("\n")) == (1, "", 1)
    assert result.err.startswith("empty failed: ")
    assert rows_of_summary(output)[2] == ["wall", "done"]


def rows_of_summary(folder: Path) -> list[list[str]]:
    return [line.split("\t")[:2] for line in (folder / "summary.1-of-1.tsv").read_text().splitlines()]


def test_summary_and_sidecar_name_options_as_the_terminal_does(fecosplat, networks, scenes: Path, output: Path) -> None:
    result = fecosplat("batch", "encode", scenes, "-o", output, "--shard", "2/2", "--views", "0,9")
    sentence = f"{scenes / 'wall'}: there is no view 9; give indices from 0 to 3 in --views."
    assert result.err.startswith(f"wall failed: {sentence}\n")
    assert (output / "summary.2-of-2.tsv").read_text().splitlines()[1].endswith(f"\t{sentence}")
    assert json.loads((output / "wall.fcs.json").read_text())["error"] == sentence


def test_a_scheduler_that_does_not_answer_writes_nothing(fecosplat, tmp_path, monkeypatch) -> None:
    cluster = pytest.importorskip("fecocodec.batch.cluster", exc_type=ImportError)
    monkeypatch.setattr(cluster, "SECONDS_TO_ANSWER", 1)
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "wall.fcs").write_bytes(b"")
    output = tmp_path / "output"
    result = fecosplat("batch", "decode", tmp_path / "scenes", "-o", output, "--scheduler", "tcp://127.0.0.1:1")
    assert (result.code, result.out) == (1, "")
    assert result.err == (
        "fecosplat: scheduler tcp://127.0.0.1:1: it does not answer within 1 s; start `dask scheduler`, or correct the "
        "address.\n"
    )
    assert not output.exists()


def test_a_missing_extra_names_it_and_the_way_without(fecosplat, networks, scenes, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(run, "find_spec", lambda _name: None)
    result = fecosplat("batch", "encode", scenes, "-o", tmp_path / "output")
    assert (result.code, result.out) == (1, "")
    assert result.err == (
        "fecosplat: several processes need the package distributed; run `pip install '.[cluster]'` in the "
        "project's folder, or use one process by --workers 1.\n"
    )
    assert not (tmp_path / "output").exists()
    alone = fecosplat("batch", "encode", scenes, "-o", tmp_path / "output", "--workers", "1", *FAST)
    assert "several processes" not in alone.err
    assert list((tmp_path / "output").glob("*.fcs"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--shard", "3/2"), "'3/2' is not I/N with I from 1 to N"),
        (("--shard", "1/2", "--workers", "2"), "--scheduler, --workers and --shard exclude each other"),
        (("--workers", "0"), "0 is not in the range x>=1"),
        (("--effort", "fast", "--sharpness", "1"), "--sharpness needs the steps that --effort fast leaves out"),
    ],
)
def test_wrong_usage_exits_with_2(fecosplat, scenes: Path, output: Path, arguments, message: str) -> None:
    result = fecosplat("batch", "encode", scenes, "-o", output, *arguments)
    assert (result.code, result.out) == (2, "")
    assert message in result.err
    assert list(output.iterdir()) == []


@pytest.mark.parametrize(
    ("threads", "given", "expected"), [("1", None, (4, 1)), ("2", None, (2, 2)), ("8", None, (1, 8)), ("2", 3, (3, 2))]
)
def test_workers_share_the_cores(threads, given, expected, tmp_path, monkeypatch) -> None:
    cluster = pytest.importorskip("fecocodec.batch.cluster", exc_type=ImportError)
    asked = []

    class StartedError(Exception):
        pass

    def start(*sizes: int):
        asked.append(sizes)
        raise StartedError

    monkeypatch.setattr(cluster, "local_cluster", start)
    monkeypatch.setattr(batch_options, "num_cores", lambda: 4)
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    options = batch_options.BatchOptions(tmp_path, None, given, None, False, False, False)
    with pytest.raises(StartedError), batch_options.engine_of(options):
        pass
    assert asked == [expected]
