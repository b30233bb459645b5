"""Ablations and ways to trade time are systems whose streams every receiver decodes."""

from pathlib import Path

import pytest
import torch

from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED
from fecocodec.errors import InputError
from fecocodec.evaluation.systems.codec import ABLATIONS, codec_system, on_one_thread, speed_systems
from fecocodec.evaluation.systems.groups import systems_of
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.evaluation.systems.uncoded import uncoded_gaussians
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.optimisation_config import EFFORTS, FAST
from tests.example_scenes import MODEL, example_views

LAMBDA = 1e-3


@pytest.fixture(scope="module")
def codec(random_weights: Path) -> Codec:
    return load_codec(random_weights / MODEL, "cpu")


def run(system: System, side: int = 64) -> Reconstruction:
    return system.reconstruct(example_views(3, side, side), 2)


def test_ablations_change_what_is_sent(codec: Codec, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(EFFORTS, "default", FAST)
    systems = systems_of(["ablations"], codec, [LAMBDA])
    assert [system.name for system in systems] == ["stage 1 alone", "no decoded context", "no rendered feedback"]
    stage_1, *others, whole = [run(system) for system in (*systems, codec_system(codec, LAMBDA))]
    assert stage_1.num_bytes < min(other.num_bytes for other in others)
    assert all(not torch.equal(other.images, whole.images) for other in others)


def test_an_ablation_can_be_asked_for_alone(codec: Codec) -> None:
    for part in ABLATIONS:
        assert len(systems_of([part], codec, [1e-2, 1e-4])) == 2
    with pytest.raises(InputError, match=r"no systems called magic; choose from codec, fast, best, .*ablations"):
        systems_of(["codec", "magic"], codec, [LAMBDA])


def test_one_thread_makes_the_same_pictures() -> None:
    """Without latent optimisation, whose steps can turn a last bit into a symbol (docs/limits.md)."""
    fast = codec_system(load_codec(SHIPPED / DEFAULT_MODEL, "cpu"), LAMBDA, effort="fast")
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        two, one = run(fast), run(on_one_thread(fast, "lambda 1e-3"))
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    # Sums differ in their last bits with the number of threads, which may turn a symbol: 80 dB, not equality.
    assert float((one.images - two.images).square().mean()) < 1e-8


def test_photographs_of_half_the_size_are_drawn_at_the_whole(codec: Codec) -> None:
    systems = {system.name: system for system in speed_systems(codec, LAMBDA)}
    half, whole = (run(systems[name], side=128) for name in ("half the size", "fecosplat, effort fast"))
    assert half.images.shape[-2:] == (128, 128) and half.num_bytes < whole.num_bytes


def test_latents_that_are_not_coded_are_optimised_for_distortion_alone(codec: Codec) -> None:
    views = example_views(2)
    as_given, optimised = (uncoded_gaussians(codec, views, FAST.with_steps(steps)) for steps in (0, 3))

    def distortion(gaussians: Gaussians) -> float:
        drawn = render(gaussians, views.cameras, views.image_size).color
        return float(FAST.distortion(drawn, views.images).mean())

    assert distortion(optimised) < distortion(as_given)
