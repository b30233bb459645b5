"""Stage 1 is coded more coarsely than stage 2, and files say so.

The paper's distortion, with its perceptual term.
"""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec.config import Method
from fecocodec.container import LAMBDA_Q_MAX, dequantise_lambda, read_stream
from fecocodec.errors import InputError
from fecocodec.rendering.perceptual import st_lpips
from fecocodec.sender.codec import load_codec
from fecocodec.sender.distortion import PerceptualDistortion
from fecocodec.sender.encode import encode_with
from fecocodec.sender.lambda_roles import stage_lambdas
from fecocodec.sender.optimisation_config import FAST
from tests.container.example_streams import example_stream
from tests.example_scenes import MODEL, example_views


@pytest.mark.parametrize("lambda_q", [0, 1179, LAMBDA_Q_MAX])
def test_six_times_the_lambda(lambda_q: int) -> None:
    header = replace(example_stream().header, lambda_q=lambda_q, first_stage_excess=Method.stage_1_offset)
    assert [header.lambda_q_of_stage(stage) for stage in (1, 2)] == stage_lambdas(lambda_q, 2)
    assert header.lambda_of_stage(1) == pytest.approx(6 * header.lambda_of_stage(2), rel=0.01)
    assert header.lambda_of_stage(2) == dequantise_lambda(lambda_q)


def test_lambdas_of_a_batch_are_those_of_each_scene() -> None:
    lambda_q = torch.tensor([0, 1179, 1768])
    first, second, third = stage_lambdas(lambda_q, 3)
    assert first.tolist() == [stage_lambdas(value, 2)[0] for value in (0, 1179, 1768)]
    assert torch.equal(second, lambda_q) and torch.equal(third, lambda_q)
    assert torch.equal(stage_lambdas(lambda_q, 1)[0], lambda_q)  # a single stage must be as good as it gets


def test_headers_say_what_stages_were_coded_at(random_weights: Path) -> None:
    codec = load_codec(random_weights / MODEL, "cpu")
    two, one = (read_stream(encode_with(codec, example_views(2), 1000, stages, FAST)).header for stages in (2, 1))
    assert (two.lambda_q_of_stage(1), two.lambda_q_of_stage(2)) == tuple(stage_lambdas(1000, 2))
    assert (one.lambda_q_of_stage(1), one.first_stage_excess) == (1000, 0)


def test_the_papers_distortion_adds_a_twentieth_of_the_perceptual_distance() -> None:
    generator = torch.Generator().manual_seed(0)
    renderings, images = (torch.rand(2, 3, 32, 32, generator=generator) for _ in range(2))
    renderings.requires_grad_()
    found = PerceptualDistortion()(renderings, images)
    squared = (renderings - images).square().mean(dim=(1, 2, 3))
    torch.testing.assert_close(found, squared + 0.05 * st_lpips(renderings, images))
    plain, whole = (torch.autograd.grad(x.sum(), renderings, retain_graph=True)[0] for x in (squared, found))
    assert (whole - plain).abs().sum() > 0.0


def test_unknown_distances_are_refused() -> None:
    with pytest.raises(InputError, match="no perceptual distance 'vgg'; choose one of st-lpips, lpips"):
        PerceptualDistortion("vgg")
