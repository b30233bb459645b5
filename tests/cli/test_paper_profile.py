"""`fecosplat info --parameters paper`: the paper's profile at the paper's size."""

import json

import pytest

from tests.cli.conftest import CommandLine

EXTRACTOR = {
    "extractor.backbone": 1_049_120,
    "extractor.transformer": 3_150_336,
    "extractor.pretrained": 22_056_192,
    "extractor.regressor": 6_453_504,
    "extractor.regressor_residual": 98_432,
}


def test_sums_are_the_papers_within_one_percent(fecosplat: CommandLine) -> None:
    rows = json.loads(fecosplat("info", "--parameters", "paper", "--json").out)
    counts = {row["module"]: row["parameters"] for row in rows if row["side"] != "sum"}
    assert {name: count for name, count in counts.items() if name.startswith("extractor")} == EXTRACTOR
    receiver, sender = (row for row in rows if row["side"] == "sum")
    assert (receiver["published"], sender["published"]) == (3.45e6, 37.28e6)
    for row in (receiver, sender):
        assert row["parameters"] == pytest.approx(row["published"], rel=0.01)
    assert sender["parameters"] == sum(counts.values())


def test_the_table_shows_the_papers_table_1_beside_ours(fecosplat: CommandLine) -> None:
    lines = fecosplat("info", "--parameters", "paper").out.splitlines()
    assert lines[0].endswith("paper's Table 1")
    assert "3.45 M (+" in lines[-2] and "37.28 M (+" in lines[-1]
