"""Graphs belong to weights: they are complete, were exported from the weights beside them, and say so if not.

Groups of views: every view once, in order, and as many at a time as their maps allow.
"""

import shutil
from pathlib import Path

import onnx
import pytest

from fecocodec import decoding
from fecocodec.decoding import decode
from fecocodec.errors import ModelError
from fecocodec.model_files import GRAPHS_FOLDER, RECEIVER_FILE, SHIPPED, model_id_of, receiver_kind
from fecocodec.runtime.graphs import CELLS_AT_ONCE, groups_of_views
from tests.vectors.paper_model import PAPER_MODEL
from tests.vectors.tiny_graphs import FOLDER as TINY_GRAPHS
from tests.vectors.tiny_model import TINY_MODEL, VECTORS

PRIOR = {"hyper", "features_1", "features_2", "pass_1", "pass_2", "step_1", "step_2", "step_3"}
MODELS = sorted(path.parent for path in SHIPPED.glob(f"*/{RECEIVER_FILE}"))
SCENE = VECTORS / "valid" / "scene-compact-6.fcs"
COMMAND = "python -m fecocodec.training.graphs"


OF_PAPER = PRIOR | {"update", "points", "attend", "attributes"}


@pytest.mark.parametrize(
    ("weights", "folder", "names"),
    [
        *((model / RECEIVER_FILE, model / GRAPHS_FOLDER, None) for model in MODELS),
        (PAPER_MODEL / RECEIVER_FILE, PAPER_MODEL / GRAPHS_FOLDER, OF_PAPER),
        (TINY_MODEL, TINY_GRAPHS, PRIOR),
    ],
)
def test_a_model_has_all_graphs_of_its_weights(weights: Path, folder: Path, names: set[str] | None) -> None:
    """names: None for those of its kind."""
    data = weights.read_bytes()
    if weights != TINY_MODEL:  # which is an entropy model alone
        of_kind = set(receiver_kind(data).graph_names)
        assert names == of_kind or (names is None and len(of_kind) == 21)
        names = of_kind
    assert {path.stem for path in folder.iterdir()} == names
    for path in folder.iterdir():
        model = onnx.load(path, load_external_data=False)
        metadata = {entry.key: entry.value for entry in model.metadata_props}
        again = f"{path} was exported from other weights: run {COMMAND} {folder.parent}"
        assert metadata == {"model_id": model_id_of(data).hex(), "graph": path.stem}, again
        assert path.stat().st_size < 1 << 18, "a graph holds no weights of its own"


def test_weights_of_another_version_have_no_kind() -> None:
    for header in (b'{"__metadata__": {"config": "{}"}', b"{}"):
        with pytest.raises(ModelError, match=r"^the weights of the receiver are of another version; install that"):
            receiver_kind(len(header).to_bytes(8, "little") + header)


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the model of the scene, where torch is not installed."""
    monkeypatch.setattr(decoding, "find_spec", lambda _name: None)
    folder = tmp_path / "model"
    shutil.copytree(SHIPPED / "compact-6", folder)
    return folder


def test_graphs_of_other_weights_are_refused(model: Path) -> None:
    shutil.copy(TINY_GRAPHS / "hyper.onnx", model / GRAPHS_FOLDER)
    with pytest.raises(ModelError, match=rf"hyper.onnx: .*model id {model_id_of(TINY_MODEL.read_bytes()).hex()}"):
        decode(SCENE.read_bytes(), model=model)


def test_a_damaged_graph_is_refused(model: Path) -> None:
    (model / GRAPHS_FOLDER / "update.onnx").write_bytes(b"no graph")
    with pytest.raises(ModelError, match=r"update.onnx: onnxruntime cannot load this graph"):
        decode(SCENE.read_bytes(), model=model)


@pytest.mark.parametrize(
    ("grid", "num_threads", "sizes"),
    [
        ((2, 64, 64), 2, [1, 1]),
        ((7, 64, 64), 2, [4, 3]),
        ((7, 64, 64), 1, [7]),
        ((16, 128, 128), 2, [1] * 16),
        ((1, 64, 64), 2, [1]),
        ((3, 64, 64), 16, [3]),
        ((3, 256, 256), 2, [1, 1, 1]),
    ],
)
def test_groups_visit_every_view_once(grid: tuple[int, int, int], num_threads: int, sizes: list[int]) -> None:
    views = list(range(grid[0]))
    slices, is_parallel = groups_of_views(grid, num_threads)
    groups = [views[group] for group in slices]
    assert [view for group in groups for view in group] == views
    assert [len(group) for group in groups] == sizes
    at_once = num_threads if is_parallel else 1
    cells = grid[1] * grid[2]
    assert all(
        (len(group) == 1 and not is_parallel) or len(group) * at_once * cells <= CELLS_AT_ONCE for group in groups
    )
