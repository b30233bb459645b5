"""`encode` and `batch encode` leave out a photograph that harms the others, unless it was asked for."""

import json
from pathlib import Path

import pytest
import torch

from fecocodec.container import inspect
from fecocodec.evaluation.stress.box_room import Room, look, painted, photograph, waves
from fecocodec.photographs.images import write_image

SIZE = (96, 128)  # height, width in pixels
POSES = torch.stack([look((step, 0.05 * step, -1.5)) for step in (-1.0, -0.6, -0.2, 0.2, 0.6, 1.0)])
WRONG = "d.png"  # a photograph of another room
FAST = ("--effort", "fast", "--stages", "1")
CHOSEN = (*FAST, "--views", "spread:6")  # every photograph, but not by name


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mixed") / "scenes" / "room"
    folder.mkdir(parents=True)
    views = photograph(Room(painted), POSES, SIZE)
    other = photograph(Room(lambda points: waves(points, 9)), POSES, SIZE)
    focal = views.cameras.intrinsics[0] * torch.tensor([SIZE[1], SIZE[0], 1.0])[:, None]
    frames = []
    for view, name in enumerate(f"{letter}.png" for letter in "abcdef"):
        write_image(folder / name, other.images[view].flip(-2) if name == WRONG else views.images[view])
        pose = POSES[view].clone()
        pose[:, 1:3] *= -1  # OpenCV to OpenGL axes
        frames.append({"file_path": name, "transform_matrix": pose.tolist()})
    lens = {"w": SIZE[1], "h": SIZE[0], "fl_x": float(focal[0, 0]), "fl_y": float(focal[1, 1])}
    bounds = {"near": float(views.cameras.near), "far": float(views.cameras.far)}
    (folder / "transforms.json").write_text(json.dumps({**lens, **bounds, "frames": frames}))
    return folder


def test_a_harmful_photograph_is_left_out_and_named(fecosplat, mixed: Path, tmp_path: Path) -> None:
    output = tmp_path / "room.fcs"
    result = fecosplat("encode", mixed, "-o", output, *CHOSEN, "--json")
    fields = json.loads(result.out)
    assert result.code == 0
    assert WRONG in fields["left_out_views"]
    kept = [view["name"] for view in fields["context_views"]]
    assert sorted(kept + fields["left_out_views"]) == [f"{letter}.png" for letter in "abcdef"]
    assert inspect(output.read_bytes()).header.num_views == len(kept)
    assert f"note: left out {', '.join(fields['left_out_views'])}: the other views are better " in result.err
    assert "; to keep all, use --views all.\n" in result.err


@pytest.mark.parametrize("views", ["all", "0,1,2,3,4,5"])
def test_photographs_that_were_asked_for_are_kept(fecosplat, mixed: Path, tmp_path: Path, views: str) -> None:
    output = tmp_path / "room.fcs"
    result = fecosplat("encode", mixed, "-o", output, *FAST, "--json", "--views", views)
    assert json.loads(result.out)["left_out_views"] == []
    assert inspect(output.read_bytes()).header.num_views == 6
    assert "left out" not in result.err


def test_a_batch_leaves_out_the_same_and_records_it(fecosplat, mixed: Path, tmp_path: Path) -> None:
    single, coded = tmp_path / "room.fcs", tmp_path / "coded"
    assert fecosplat("encode", mixed, "-o", single, *CHOSEN).code == 0
    assert fecosplat("batch", "encode", mixed.parent, "-o", coded, "--shard", "1/1", *CHOSEN).code == 0
    assert (coded / "room.fcs").read_bytes() == single.read_bytes()
    record = (coded / "room.fcs.json").read_text()
    assert "left out" in record and WRONG not in json.loads(record)["details"]["views"]
