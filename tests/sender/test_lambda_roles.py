"""Stage 1 is coded more coarsely than stage 2, and files say so."""

from dataclasses import replace

import pytest
import torch

from fecocodec.config import Method
from fecocodec.container import LAMBDA_Q_MAX, dequantise_lambda, read_stream
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with
from fecocodec.sender.lambda_roles import stage_lambdas
from fecocodec.sender.optimisation_config import FAST
from tests.container.example_streams import example_stream
from tests.example_scenes import example_views


@pytest.mark.parametrize("lambda_q", [0, 1179, LAMBDA_Q_MAX])
def test_six_times_the_lambda(lambda_q: int) -> None:
    header = replace(example_stream().header, lambda_q=lambda_q, first_stage_excess=Method.stage_1_offset)
    assert [header.lambda_q_of_stage(stage) for stage in (1, 2)] == stage_lambdas(lambda_q, 2)
    assert header.lambda_of_stage(1) == pytest.approx(6 * header.lambda_of_stage(2), rel=0.01)
    assert header.lambda_of_stage(2) == dequantise_lambda(lambda_q)


def test_lambdas_of_stages_stand_in_headers(codec: Codec) -> None:
    lambda_q = torch.tensor([0, 1179, 1768])
    first, second, third = stage_lambdas(lambda_q, 3)
    assert first.tolist() == [stage_lambdas(value, 2)[0] for value in (0, 1179, 1768)]
    assert torch.equal(second, lambda_q) and torch.equal(third, lambda_q)
    assert torch.equal(stage_lambdas(lambda_q, 1)[0], lambda_q)  # a single stage must be as good as it gets
    two, one = (read_stream(encode_with(codec, example_views(2), 1000, stages, FAST)).header for stages in (2, 1))
    assert (two.lambda_q_of_stage(1), two.lambda_q_of_stage(2)) == tuple(stage_lambdas(1000, 2))
    assert (one.lambda_q_of_stage(1), one.first_stage_excess) == (1000, 0)
