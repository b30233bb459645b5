"""The method "paper" switches off every addition of ours, from training to decoding. `compact` keeps them."""

from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from fecocodec.config import COMPACT, PAPER, PaperSenderConfig, ReceiverConfig, SenderConfig, stored_fields
from fecocodec.container import quantise_lambda, read_stream
from fecocodec.errors import InputError, ModelError
from fecocodec.receiver.decode import decode_with
from fecocodec.receiver.model import Receiver, load_receiver, serialise_receiver
from fecocodec.sender.codec import Codec, adapted_sender
from fecocodec.sender.distortion import PerceptualDistortion
from fecocodec.sender.encode import encode_with
from fecocodec.sender.extractors.adapter import ConditionedAdapter
from fecocodec.sender.model import PictureFeedbackExtractor, Sender
from fecocodec.sender.optimisation_config import BEST
from fecocodec.training.batch import Batch, StageOutcome
from fecocodec.training.configurations import CONFIGURATIONS, configuration_named
from fecocodec.training.loss import lambda_of
from fecocodec.training.optimisation import SHARE, build_optimiser
from fecocodec.training.training_pass import Coding, code_with_additive_noise, paper_loss, run_stages
from tests.example_scenes import example_views, fused
from tests.training.tiny_runs import synthetic_batch

pytestmark = pytest.mark.usefixtures("one_thread")

PAPERS = [name for name, configuration in CONFIGURATIONS.items() if configuration.is_paper]
LAMBDA_Q = quantise_lambda(1e-4)


def paper_codec(**changes: object) -> Codec:
    """Untrained networks with the paper's method; the compact extractor, which is faster."""
    torch.manual_seed(0)
    receiver = Receiver(ReceiverConfig(method=PAPER, **changes))  # type: ignore[arg-type]
    sender = Sender(SenderConfig(), receiver.config)
    return Codec(sender.eval().requires_grad_(False), receiver.eval().requires_grad_(False), bytes(8))


@pytest.fixture(scope="module")
def codec() -> Codec:
    return paper_codec()


@pytest.fixture(scope="module")
def batch() -> Batch:
    return synthetic_batch(num_target=2)


@pytest.mark.parametrize("name", PAPERS)
def test_no_configuration_of_the_paper_has_an_addition_of_ours(name: str) -> None:
    found = configuration_named(name)
    assert found.is_paper and found.receiver.kind.stage_1_offset == 0 and found.receiver.sh_degree == 2
    assert found.distortion == PerceptualDistortion(perceptual_weight=0.05)
    assert found.schedule.one_stage_until == found.schedule.bypass_until == 0 and found.schedule.warm_up == 1
    assert found.schedule.learning_rate == 2e-4 and found.schedule.disparity_weight == (0.0, 0.0)
    assert found.schedule.photograph_share == (1.0, 1.0)
    assert found.alone_every == 0 and found.kept_batches == 0
    assert found.optimiser.average_decay == 0.0 and found.optimiser.backbone_share * 2e-4 == pytest.approx(2e-6)
    assert found.protocol is not None and found.precision == "bfloat16" and found.shapes.num_scenes == 1


def test_the_method_is_stored_with_the_weights_and_compact_files_do_not_change(codec: Codec, tmp_path: Path) -> None:
    path = tmp_path / "receiver.safetensors"
    path.write_bytes(serialise_receiver(codec.receiver))
    assert load_receiver(path)[0].config == codec.receiver.config
    assert stored_fields(codec.receiver.config)["method"] == PAPER
    assert {"method", "sh_degree", "gaussians_per_side", "lambda_range", "num_stages"}.isdisjoint(
        stored_fields(ReceiverConfig())
    )


def test_streams_have_one_lambda_rounded_latents_and_no_optimisation(codec: Codec) -> None:
    views = example_views(2)
    data = encode_with(codec, views, LAMBDA_Q)
    header = read_stream(data).header
    assert header.lambda_q_of_stage(1) == header.lambda_q_of_stage(2) == LAMBDA_Q
    assert encode_with(codec, views, LAMBDA_Q, config=BEST) == data
    single = Codec(codec.sender, paper_codec(num_stages=1).receiver, bytes(8))
    assert read_stream(encode_with(single, views, LAMBDA_Q)).header.num_stages == 1


def test_decoded_gaussians_are_those_of_the_predictor(codec: Codec) -> None:
    """No layers, no free-space check, no fitted directions, no merging; the compact method has all four."""
    data = encode_with(codec, example_views(2), LAMBDA_Q)
    found = decode_with(codec.receiver, data).gaussians
    assert found.count == 2 * 32 * 32 and found.harmonics.shape[1] == 1
    usual = Receiver(ReceiverConfig())
    usual.load_state_dict(codec.receiver.state_dict())
    others = decode_with(usual.eval(), data, merging=None).gaussians
    assert others.count > found.count and others.harmonics.shape[1] == 4
    assert float(others.opacities[: found.count].sum()) < float(found.opacities.sum())


@pytest.mark.parametrize("per_side", [1, 4])
def test_gaussians_at_other_resolutions(per_side: int) -> None:
    codec = paper_codec(gaussians_per_side=per_side)
    data = encode_with(codec, example_views(2), LAMBDA_Q, num_stages=1)
    assert decode_with(codec.receiver, data).gaussians.count == 2 * (16 * per_side) ** 2
    with pytest.raises(ModelError, match=f"{per_side} Gaussians a side of a cell with the method 'compact'"):
        Receiver(ReceiverConfig(gaussians_per_side=per_side))


def test_training_and_decoding_have_predicted_harmonics(batch: Batch) -> None:
    codec = paper_codec(sh_degree=2)
    data = encode_with(codec, example_views(2), LAMBDA_Q)
    assert decode_with(codec.receiver, data).gaussians.harmonics.shape[1] == 9
    last = codec.receiver.predictor.head[2].weight.requires_grad_()
    code = code_with_additive_noise(codec.receiver, codec.sender)
    (first, _), _ = run_stages(codec.sender, codec.receiver, batch, code, 2, has_all_targets=True)
    (gradient,) = torch.autograd.grad(first.images.square().sum(), last)
    assert (gradient[4 * 14 :].abs().amax(dim=(1, 2, 3)) > 0).all()  # of coefficients 1 to 8 of four Gaussians
    with pytest.raises(ModelError, match="degree 2 are not supported with the method 'compact'; choose at most 0"):
        Receiver(ReceiverConfig(sh_degree=2))


def test_what_does_not_exist_is_refused() -> None:
    narrow = paper_codec(lambda_range=(1e-5, 1e-3))
    with pytest.raises(InputError, match=r"lambda is 0\.01, but the model was trained for 1e-05 to 0\.001; choose a"):
        encode_with(narrow, example_views(2), quantise_lambda(1e-2))
    with pytest.raises(ModelError, match="no method 'ours'; choose compact or paper"):
        Receiver(ReceiverConfig(method="ours"))
    with pytest.raises(ModelError, match="no ablation 'no-depth'"):
        Sender(PaperSenderConfig(ablation="no-depth"), ReceiverConfig(method=COMPACT))


def test_feedback_sees_the_two_pictures_alone(codec: Codec) -> None:
    feedback = codec.sender.feedback
    assert isinstance(feedback, PictureFeedbackExtractor) and feedback.input.in_channels == 2 * 3 * 16
    images, renderings = torch.rand(2, 1, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    condition = codec.receiver.condition(torch.tensor([LAMBDA_Q]), 2)
    depths = torch.zeros(1, 2, 8, 8), torch.ones(1, 2, 8, 8)
    first, second = (feedback(images, renderings, errors, condition) for errors in depths)
    assert torch.equal(first, second)


def test_noise_is_additive_in_the_latent_and_in_the_rate(codec: Codec, batch: Batch) -> None:
    seen: list[tuple[Tensor, Tensor]] = []
    code = code_with_additive_noise(codec.receiver, codec.sender)

    def watched(y: Tensor, inputs: object) -> object:
        coded = code(y, inputs)  # type: ignore[arg-type]
        seen.append((y, coded.y_hat))
        return coded

    first, second = stages_of(codec, batch, watched)  # type: ignore[arg-type]
    for y, y_hat in seen:
        noise = y_hat - y
        assert noise.abs().max() <= 0.51 and 0.27 < noise.std() < 0.31  # means are multiples of 1/256
    assert first.images.shape[1] == second.images.shape[1] == 4  # all targets of both stages
    assert first.estimated_bits > 0 and second.estimated_bits > 0


def stages_of(codec: Codec, batch: Batch, coding: Coding | None = None) -> list[StageOutcome]:
    torch.manual_seed(0)
    coding = coding or code_with_additive_noise(codec.receiver, codec.sender)
    return run_stages(codec.sender, codec.receiver, batch, coding, 2, None, 0.0, has_all_targets=True)[0]


def test_the_loss_is_the_papers_sum(codec: Codec, batch: Batch) -> None:
    stages = stages_of(codec, batch)
    distortion = PerceptualDistortion()
    found, parts = paper_loss(batch, stages, distortion)
    expected = torch.zeros(())
    for number, stage in enumerate(stages, start=1):
        rate = float(stage.estimated_bits) / (2 * 64 * 64)
        expected += float(lambda_of(batch.lambda_q)) * rate
        for view in range(batch.num_context, batch.images.shape[1]):
            expected += distortion(stage.images[0, view], batch.images[0, view])
        assert parts[f"bpp{number}"] == pytest.approx(rate)
    torch.testing.assert_close(found, expected)


def test_only_the_pretrained_backbone_has_a_smaller_learning_rate() -> None:
    networks = nn.ModuleDict({"sender": nn.ModuleDict({"extractor": nn.ModuleDict({
        "pretrained": nn.Linear(2, 2), "backbone": nn.Linear(2, 2),
    })})})  # fmt: skip
    config = configuration_named("paper-re10k").optimiser
    others, backbone = build_optimiser(networks, config).param_groups
    assert backbone[SHARE] == 0.01 and SHARE not in others
    assert [p.data_ptr() for p in backbone["params"]] == [
        p.data_ptr() for p in networks["sender"]["extractor"]["pretrained"].parameters()
    ]
    assert len(build_optimiser(networks, configuration_named("compact").optimiser).param_groups) == 1


class Edges:
    """A third-party extractor."""

    def num_channels(self) -> int:
        return 3

    def features(self, images: Tensor, cameras: object) -> Tensor:
        return images

    def fingerprint(self) -> str:
        return "edges"


def test_every_2d_block_of_the_adapter_depends_on_lambda() -> None:
    sender = adapted_sender(Edges(), ReceiverConfig(method=PAPER))
    assert isinstance(sender.extractor, ConditionedAdapter)
    codec = Codec(sender.eval().requires_grad_(False), paper_codec().receiver, bytes(8))
    assert decode_with(codec.receiver, encode_with(codec, example_views(2), LAMBDA_Q)).stages == 2
    with pytest.raises(ModelError, match="The adapter depends on lambda"):
        images, cameras = example_views(1).images[None], example_views(1).cameras.as_batch()
        fused(sender.extractor, images, cameras)


@pytest.mark.parametrize("ablation", ["no-context", "no-feedback", "no-context no-feedback"])
def test_ablations_of_the_sender_change_stage_2_alone(codec: Codec, batch: Batch, ablation: str) -> None:
    """In encoding and in training."""
    part = Sender(SenderConfig(ablation=ablation), codec.receiver.config)
    part.load_state_dict(codec.sender.state_dict())
    senders = codec.sender, part.eval().requires_grad_(False)
    whole, without = (
        read_stream(encode_with(Codec(sender, codec.receiver, bytes(8)), example_views(2), LAMBDA_Q)).payloads
        for sender in senders
    )
    assert whole[0] == without[0] and whole[1] != without[1]
    rates = [
        [float(stage.estimated_bits) for stage in stages_of(Codec(sender, codec.receiver, bytes(8)), batch)]
        for sender in senders
    ]
    assert rates[0][0] == rates[1][0] and rates[0][1] != rates[1][1]
