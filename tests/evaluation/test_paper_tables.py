"""Other systems' results from a CSV file, the paper's Table 1, and shards."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from fecocodec.errors import InputError
from fecocodec.evaluation.evaluation import COMPLEXITY_TABLE, Plan, evaluate_to_folder
from fecocodec.evaluation.paper_tables import PUBLISHED, complexity_table, quality_charts, read_external
from fecocodec.evaluation.summary import ExternalRow, averages, compare
from fecocodec.evaluation.systems.groups import LAMBDAS, lambdas_in_range
from fecocodec.sender.codec import Codec
from tests.chunk_files import write_wall_chunks
from tests.evaluation.test_report import curve
from tests.example_scenes import MODEL

CSV = "system,setting,kib,psnr,lpips,sender_params\nCodecSplat,a,8,20,0.2,\nCodecSplat,b,16,21,0.1,181.73\n"


@pytest.fixture
def external(tmp_path: Path) -> tuple[ExternalRow, ...]:
    path = tmp_path / "others.csv"
    path.write_text(CSV)
    return read_external(path)


def test_rows_are_read_and_empty_cells_are_not_measured(external: tuple[ExternalRow, ...]) -> None:
    assert external[0] == ExternalRow("CodecSplat", "a", 8.0, 20.0, lpips=0.2)
    assert external[1].sender_params == 181.73


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("system,speed\nA,1\n", "its columns must be among system, setting, kib"),
        ("kib\n1\n", "with system; name them so"),
        ("system,kib\nA,much\n", "line 2: kib is 'much', not a number; leave it empty"),
        ("system,kib\nA\n", "line 2: has no system, or not one cell a column"),
        ("system,kib\n,1\n", "line 2: has no system"),
    ],
)
def test_bad_files_are_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "others.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence):
        read_external(path)
    with pytest.raises(InputError, match="not a CSV file that can be read"):
        read_external(tmp_path / "missing.csv")


def test_external_curves_are_drawn_and_compared(external: tuple[ExternalRow, ...]) -> None:
    rows = averages(curve("fecosplat", 4.0, 20.0))
    charts = {chart.name: chart for chart in quality_charts(rows, external)}
    assert set(charts) == {"curves_psnr", "curves_ssim", "curves_lpips"}
    assert [series.name for series in charts["curves_psnr"].series] == ["fecosplat", "CodecSplat"]
    assert [mark.y for mark in charts["curves_lpips"].series[0].marks] == [0.2, 0.1]
    assert [found.baseline for found in compare((*rows, *external))] == ["CodecSplat"]


def test_other_systems_have_the_papers_numbers_unless_a_file_has_others(
    codec: Codec, external: tuple[ExternalRow, ...]
) -> None:
    table = complexity_table(codec, averages(curve("fecosplat", 4.0, 20.0)), external)
    lines = [line for line in table.splitlines()[2:] if line.startswith("|")]
    counted = ["DepthSplat-Small, features", "DepthSplat-Base, features"]
    assert [line.split(" | ")[0].removeprefix("| ") for line in lines] == [*PUBLISHED, *counted, "fecosplat"]
    assert lines[0] == "| ELIC -> DepthSplat | 26.45 | 62.40 | 0.077 | 0.181 | 1.505 | published |"
    assert lines[2] == "| DepthSplat -> TinySplat | 38.34 | N/A | 1.285 | 0.375 | 1.365 | published |"
    assert lines[6] == "| CodecSplat | 181.73 |  |  |  |  | external |", "no cell of the paper beside a file's"
    assert lines[8] == "| ELIC -> DepthSplat (Base) | 26.45 | 144.81 |  |  |  | published |"
    assert lines[10] == "| DepthSplat-Small, features | 32.81 |  |  |  |  | counted |"
    assert lines[-1].endswith("| 3.46 | 1.000 | 0.100 |  | measured |")


def test_shards_are_merged_by_the_same_plan_without_one(tmp_path: Path, random_weights: Path) -> None:
    root, index = write_wall_chunks(tmp_path / "chunks", num_scenes=2), tmp_path / "index.json"
    index.write_text(json.dumps({f"wall{n}": {"context": [0, 2], "target": [1]} for n in range(2)}))
    plan = Plan(root, index, random_weights / MODEL, tmp_path / "out", ("fast",), (1e-2,), (64, 64), with_strips=False)
    for number in (1, 2):
        evaluate_to_folder(replace(plan, shard=(number, 2)))
    assert sorted(path.name for path in plan.output.iterdir()) == [
        "measurements_1_of_2.jsonl", "measurements_2_of_2.jsonl",
    ]  # fmt: skip
    (average,) = evaluate_to_folder(plan).averages
    assert average.entries == 2
    assert not (plan.output / "measurements.jsonl").exists(), "nothing was measured again"
    assert (plan.output / COMPLEXITY_TABLE).read_text().startswith("| method | sender, M parameters |")


def test_lambdas_are_those_of_the_model(codec: Codec) -> None:
    assert lambdas_in_range(codec, None) == LAMBDAS
    config = replace(codec.receiver.config, lambda_range=(1e-5, 1e-3))
    before, codec.receiver.config = codec.receiver.config, config
    try:
        assert lambdas_in_range(codec, None) == (1e-3, 3e-4, 1e-4, 1e-5)
        with pytest.raises(InputError, match=r"but the model was trained for 1e-05 to 0\.001"):
            lambdas_in_range(codec, (1e-2,))
    finally:
        codec.receiver.config = before
