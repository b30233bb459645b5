"""The receiver without torch emits the Gaussians of the receiver with torch, within the tolerances of FORMAT.md."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from fecocodec import decoding
from fecocodec.checkpoint import find_receiver
from fecocodec.coding.camera_packing import unpack
from fecocodec.container import inspect, read_stream, write_stream
from fecocodec.decoding import decode
from fecocodec.errors import BitstreamError, InputError
from fecocodec.geometry.gaussian_arrays import SceneCameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.decode import decode as decode_with_torch
from fecocodec.receiver.decode import reconstruct
from fecocodec.receiver.model import load_receiver
from fecocodec.receiver.state import State
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from fecocodec.runtime.emission import EmissionConfig, emit
from fecocodec.runtime.graphs import Graphs, graphs_of
from fecocodec.runtime.prediction import LastState
from fecocodec.splatting.background import DEFAULT_BACKGROUND
from fecocodec.splatting.emission import Emission
from tests.example_scenes import cameras_in_a_row
from tests.vectors.chosen_symbols import cells_covered, levels_of
from tests.vectors.gaussian_difference import beyond, difference, without_rendering
from tests.vectors.gaussian_samples import PAPER_STREAM, table
from tests.vectors.paper_model import PAPER_MODEL
from tests.vectors.tiny_model import VECTORS

SCENE = (VECTORS / "valid" / "scene-compact-6.fcs").read_bytes()
MODEL_ID = read_stream(SCENE).header.model_id


def test_the_papers_method_agrees_with_torch_in_all_measures() -> None:
    """Both emit what the predictor gives: harmonics of degree 2, and no layer; or those of a smaller degree."""
    data = (VECTORS / PAPER_STREAM).read_bytes()
    assert decoding.has_graphs(PAPER_MODEL, read_stream(data).header.model_id)
    found, expected = decode(data, model=PAPER_MODEL), decode_with_torch(data, model=PAPER_MODEL)
    assert 1500 < found.gaussians.count <= 2 * 32 * 48 and found.gaussians.harmonics.shape[1] == 9
    for degree in (0, 1):
        decoded = [run(data, model=PAPER_MODEL, sh_degree=degree) for run in (decode, decode_with_torch)]
        for fewer, whole in zip(decoded, (found, expected), strict=True):
            fewer_harmonics, harmonics = (torch.as_tensor(of.gaussians.harmonics) for of in (fewer, whole))
            assert torch.equal(fewer_harmonics, harmonics[:, : (degree + 1) ** 2])
    worst = difference(data, table(expected.gaussians), table(Gaussians.of(found.gaussians)))
    assert beyond(worst, "full") == [], worst


def test_the_scene_agrees_with_that_of_torch_in_all_measures() -> None:
    found = decode(SCENE, has_background=False, is_merged=False)
    expected = decode_with_torch(SCENE, background=None, merging=None)
    worst = difference(SCENE, table(expected.gaussians), table(Gaussians.of(found.gaussians)))
    assert beyond(worst, "full") == [], worst
    assert (found.image_size, found.stages, found.damage) == (expected.image_size, expected.stages, expected.damage)
    for mine, theirs in zip(found.cameras.fields(), expected.cameras.fields(), strict=True):
        torch.testing.assert_close(torch.as_tensor(mine), theirs, atol=0.0, rtol=0.0)


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({"stages": 1, "is_merged": False}, id="stage 1"),
        pytest.param({"sh_degree": 0, "is_merged": False}, id="degree 0"),
        pytest.param({}, id="merged"),
    ],
)
def test_all_options_agree(options: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    found = Gaussians.of(decode(SCENE, **options).gaussians)
    monkeypatch.setattr(decoding, "has_graphs", lambda _folder, _model_id: False)
    expected = Gaussians.of(decode(SCENE, **options).gaussians)
    assert found.harmonics.shape[1:] == expected.harmonics.shape[1:]
    assert found.count == pytest.approx(expected.count, abs=3)
    if "is_merged" in options:
        assert beyond(without_rendering(SCENE, table(expected), table(found)), "full") == []
    else:  # which pairs are merged can change with the last bit of a cost
        cameras, size = unpack(read_stream(SCENE).cameras), (128, 192)
        images = [render(gaussians, cameras, size).color for gaussians in (found, expected)]
        assert float(psnr(*images).min()) > 60.0


def test_coverage_fading_and_detail_act_as_with_torch() -> None:
    stream = read_stream(SCENE)
    data = write_stream(replace(stream, coverage=cells_covered(stream.header, 3)))
    found, expected = decode(data, is_merged=False), decode_with_torch(data, merging=None)
    assert found.gaussians.count == pytest.approx(expected.gaussians.count, abs=2)
    assert found.gaussians.count < 0.5 * decode(SCENE, is_merged=False).gaussians.count
    data = write_stream(replace(stream, fading=levels_of(stream.header)))
    found = Gaussians.of(decode(data, has_background=False, is_merged=False).gaussians)
    expected = decode_with_torch(data, background=None, merging=None)
    assert found.count == pytest.approx(expected.gaussians.count, abs=2)
    assert found.opacities.sum() == pytest.approx(float(expected.gaussians.opacities.sum()), rel=1e-4)
    assert found.opacities.sum() < 0.8 * decode(SCENE, has_background=False, is_merged=False).gaussians.opacities.sum()
    plain = write_stream(replace(read_stream(SCENE), detail=None))
    with_detail, without = decode(SCENE).gaussians, decode(plain).gaussians
    assert with_detail.count != without.count or not np.array_equal(with_detail.means, without.means)
    expected = decode_with_torch(plain).gaussians
    assert without.count == pytest.approx(expected.count, abs=2)


def test_opacities_do_not_exceed_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sigmoid of onnxruntime can be the next number after 1, which no file of Gaussians may hold."""
    run = Graphs.run

    def rounded_up(graphs: Graphs, name: str, **inputs: Any) -> list[np.ndarray]:
        outputs = run(graphs, name, **inputs)
        if name == "attributes":
            outputs[3] = np.full_like(outputs[3], np.nextafter(np.float32(1), np.float32(2)))
        return outputs

    monkeypatch.setattr(Graphs, "run", rounded_up)
    assert decode(SCENE, has_background=False).gaussians.opacities.max() == 1


@pytest.mark.parametrize(
    ("num_views", "height", "width", "is_filled"),
    [(1, 64, 64, True), (3, 64, 96, True), (16, 64, 64, False), (2, 128, 64, True)],
)
def test_networks_agree_for_any_number_of_views_and_any_size(
    num_views: int, height: int, width: int, is_filled: bool
) -> None:
    receiver, _ = load_receiver(find_receiver(MODEL_ID))
    cameras = cameras_in_a_row(*(0.3 * torch.arange(num_views)).tolist(), focal=(1.0, 1.3), near=0.5, far=40.0)
    generator = torch.Generator().manual_seed(num_views)
    state = 0.3 * torch.randn(num_views, receiver.config.state_channels, height // 4, width // 4, generator=generator)
    with torch.inference_mode():
        before = State(state, receiver.condition(torch.full((num_views,), 900), 2))
        emission = Emission(is_culled=True, background=DEFAULT_BACKGROUND, is_filled=is_filled)
        expected = reconstruct(receiver, before, cameras, emission)
    arrays = SceneCameras(cameras.extrinsics.numpy(), cameras.intrinsics.numpy(), 0.5, 40.0)
    last = LastState(state.numpy(), 900, 2)
    graphs = graphs_of(find_receiver(MODEL_ID).parent, MODEL_ID, 1)
    found = emit(graphs, last, arrays, None, EmissionConfig(1, True, None), is_filled)
    assert found.count == pytest.approx(expected.count, rel=1e-3)
    assert found.harmonics.shape[1:] == expected.harmonics.shape[1:]
    if found.count == expected.count:
        for mine, theirs, tolerance in zip(
            found.fields(), expected.fields(), (2e-4, 2e-4, 1e-2, 1e-4, 1e-3), strict=True
        ):
            torch.testing.assert_close(torch.from_numpy(mine), theirs, atol=tolerance, rtol=1e-3)


def test_intact_stages_of_a_damaged_stream_are_decoded() -> None:
    cut = {section.name: section.offset + 20 for section in inspect(SCENE).sections}
    for name, stages in (("B2", 1), ("detail", 2)):
        damaged = SCENE[: cut[name]] + bytes(len(SCENE) - cut[name])
        found = decode(damaged, stages="intact")
        assert found.stages == stages and found.damage is not None and f"section {name}" in found.damage
        with pytest.raises(BitstreamError, match=f"section {name}"):
            decode(damaged)


def test_arguments_are_checked() -> None:
    with pytest.raises(InputError, match="degree 3"):
        decode(SCENE, sh_degree=3)
    with pytest.raises(InputError, match="max_pixels"):
        decode(SCENE, max_pixels=100)
