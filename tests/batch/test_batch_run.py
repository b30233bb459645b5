"""What a batch skips, redoes, records and refuses; in one process, without networks."""

import json
from pathlib import Path

import pytest

from fecocodec.batch import scene_task
from fecocodec.batch.encode_scene import EncodeScene
from fecocodec.batch.run import run_batch, write_summary
from fecocodec.batch.scenes import BatchScene
from fecocodec.batch.sidecar import Outcome
from fecocodec.captures.view_selection import Spread
from fecocodec.codec.options import EncodingOptions
from fecocodec.errors import OutputError
from tests.batch.works import Reverse


def run(scenes, output: Path, work: Reverse | None = None, **options: bool) -> dict[str, Outcome]:
    return {of.scene: of for of in run_batch(scenes, output, work or Reverse(), **options)}


def statuses(outcomes: dict[str, Outcome]) -> dict[str, str]:
    return {name: of.status for name, of in outcomes.items()}


def num_runs(scenes: tuple[BatchScene, ...], name: str) -> int:
    return len((scenes[0].path.parent / f"{name}.runs").read_text())


def test_outputs_appear_with_a_sidecar(texts, output: Path) -> None:
    outcomes = run(texts(a="abc", b="warn"), output)
    assert statuses(outcomes) == {"a": "done", "b": "done"}
    assert sorted(path.name for path in output.iterdir()) == ["a.rev", "a.rev.json", "b.rev", "b.rev.json"]
    assert (output / "a.rev").read_bytes() == b"cba"
    sidecar = json.loads((output / "b.rev.json").read_text())
    assert sidecar["inputs"]["options"] == {"option": 1, "size": [1, 2]}
    assert sidecar["inputs"]["weights"] == {"model_id": "first"}
    assert (sidecar["status"], sidecar["num_bytes"], sidecar["details"]) == ("done", 4, {"length": 4})
    assert sidecar["warnings"] == ["warned by b"]
    assert outcomes["b"].num_warnings == 1


def test_what_changed_is_redone(texts, output: Path) -> None:
    scenes = texts(a="abc", b="def")
    run(scenes, output)
    again = run(scenes, output)
    assert statuses(again) == {"a": "skipped", "b": "skipped"}
    assert again["a"].num_bytes == 3
    assert num_runs(scenes, "a") == 1
    assert statuses(run(texts(a="new"), output)) == {"a": "done", "b": "skipped"}
    assert (output / "a.rev").read_bytes() == b"wen"
    assert statuses(run(scenes, output, overwrite=True)) == {"a": "done", "b": "done"}


@pytest.mark.parametrize("work", [Reverse(option=2), Reverse(version="second")], ids=["options", "weights"])
def test_other_options_or_weights_redo_all(texts, output: Path, work: Reverse) -> None:
    scenes = texts(a="abc", b="def")
    run(scenes, output)
    assert statuses(run(scenes, output, work)) == {"a": "done", "b": "done"}


def test_a_record_tells_a_number_of_guides_from_the_name_of_one() -> None:
    records = [EncodeScene(EncodingOptions(guides=guides)).options() for guides in (None, (), ("4",), Spread(4))]
    assert [json.dumps(record["guides"]) for record in records] == ["null", "[]", '["4"]', '{"Spread": {"count": 4}}']


def test_a_renamed_photograph_is_a_change(texts, output: Path) -> None:
    (scene,) = texts(a="abc")
    (scene.path / "1.png").write_bytes(b"x")
    run([scene], output)
    (scene.path / "1.png").rename(scene.path / "2.png")
    assert statuses(run([scene], output)) == {"a": "done"}


@pytest.mark.parametrize("spoil", [Path.unlink, lambda path: path.write_bytes(b"cut")], ids=["missing", "changed"])
def test_an_output_that_does_not_match_its_sidecar_is_redone(texts, output: Path, spoil) -> None:
    scenes = texts(a="abc")
    run(scenes, output)
    spoil(output / "a.rev")
    assert statuses(run(scenes, output)) == {"a": "done"}
    assert (output / "a.rev").read_bytes() == b"cba"


def test_failures_are_sentences_and_do_not_stop_the_rest(texts, output: Path) -> None:
    scenes = texts(a="bad", b="bug", c="abc")
    outcomes = run(scenes, output)
    assert statuses(outcomes) == {"a": "failed", "b": "failed", "c": "done"}
    assert outcomes["a"].error == f"{scenes[0].path}: the text is bad; write another."
    assert outcomes["b"].error == f"{scenes[1].path}: ValueError: a defect"
    assert sorted(path.name for path in output.iterdir()) == ["a.rev.json", "b.rev.json", "c.rev", "c.rev.json"]
    assert json.loads((output / "a.rev.json").read_text())["traceback"] is None
    assert "in run" in json.loads((output / "b.rev.json").read_text())["traceback"]


def test_failures_are_retried_on_request_or_after_a_change(texts, output: Path) -> None:
    scenes = texts(a="bad")
    run(scenes, output)
    record = (output / "a.rev.json").read_text()
    assert run(scenes, output)["a"].error == f"{scenes[0].path}: the text is bad; write another."
    assert (output / "a.rev.json").read_text() == record
    run(scenes, output, retry_failed=True)
    assert (output / "a.rev.json").read_text() != record
    assert statuses(run(texts(a="abc"), output)) == {"a": "done"}


def test_what_could_not_be_written_is_tried_again(texts, output: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenes, write = texts(a="abc"), scene_task.write_file

    def full(path: Path, data: bytes, **options: bool) -> None:
        raise OutputError(f"{path}: No space left on device; free some.")

    monkeypatch.setattr(scene_task, "write_file", full)
    assert statuses(run(scenes, output)) == {"a": "failed"}
    monkeypatch.setattr(scene_task, "write_file", write)
    assert statuses(run(scenes, output)) == {"a": "done"}


def test_a_failure_keeps_the_earlier_output(texts, output: Path) -> None:
    run(texts(a="abc"), output)
    assert statuses(run(texts(a="bad"), output)) == {"a": "failed"}
    assert (output / "a.rev").read_bytes() == b"cba"
    assert statuses(run(texts(a="abd"), output)) == {"a": "done"}


def test_a_file_without_a_sidecar_is_kept(texts, output: Path) -> None:
    (output / "a.rev").write_bytes(b"mine")
    scenes = texts(a="abc", b="def")
    outcomes = run(scenes, output)
    assert statuses(outcomes) == {"a": "failed", "b": "done"}
    assert outcomes["a"].error == (
        f"{output / 'a.rev'}: this file has no sidecar; choose another output folder or replace it by `overwrite`."
    )
    assert (output / "a.rev").read_bytes() == b"mine"
    assert not (output / "a.rev.json").exists()
    assert statuses(run(scenes, output, overwrite=True)) == {"a": "done", "b": "done"}


def test_a_file_that_replaces_a_failure_is_kept(texts, output: Path) -> None:
    scenes = texts(a="bad")
    run(scenes, output)
    (output / "a.rev").write_bytes(b"mine")
    assert statuses(run(texts(a="abc"), output)) == {"a": "failed"}
    assert (output / "a.rev").read_bytes() == b"mine"


@pytest.mark.parametrize("content", ["{}", "[1", '{"scene": 1}'])
def test_a_json_file_that_is_no_sidecar_is_kept(texts, output: Path, content: str) -> None:
    (output / "a.rev.json").write_text(content)
    outcome = run(texts(a="abc"), output)["a"]
    assert outcome.status == "failed"
    assert outcome.error is not None and outcome.error.startswith(f"{output / 'a.rev.json'}")
    assert [path.read_text() for path in output.iterdir()] == [content]


def test_an_output_folder_that_cannot_be_made_is_refused(texts, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="the folder cannot be made"):
        run_batch(texts(a="abc"), tmp_path / "file", Reverse())


def test_the_summary_is_a_table_in_the_order_of_the_scenes(texts, output: Path) -> None:
    scenes = texts(a="bad", b="abc")
    outcomes = list(reversed(run(scenes, output).values()))
    write_summary(output / "summary.tsv", scenes, outcomes)
    rows = [line.split("\t") for line in (output / "summary.tsv").read_text().splitlines()]
    assert rows[0] == ["scene", "status", "bytes", "seconds", "warnings", "output", "error"]
    assert [row[:3] for row in rows[1:]] == [["a", "failed", ""], ["b", "done", "3"]]
    assert rows[1][-1].endswith("the text is bad; write another.")
