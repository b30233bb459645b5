"""The paper's training pass: additive noise, one lambda, and D + lambda R over all target views of both stages."""

from dataclasses import dataclass

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.rate import additive_noise, estimate_latents, uniform_noise
from fecocodec.receiver.model import Receiver
from fecocodec.sender.distortion import Distortion
from fecocodec.sender.latent_coding import EstimatedLatent
from fecocodec.sender.model import Sender
from fecocodec.sender.stages import Stage, StageInputs, StageRendering
from fecocodec.training.batch import Batch, Extracted
from fecocodec.training.loss import lambda_of
from fecocodec.training.training_pass import BatchEncoder, Coding


@dataclass(frozen=True)
class RatedStage:
    """One stage of a pass. images: renderings of all views. rate: bits per context pixel."""

    images: Float[Tensor, "batch view 3 h w"]
    rate: Float[Tensor, " batch"]


class PaperBatchEncoder(BatchEncoder):
    """Batch encoder that renders all views after every stage: feedback needs context views, the loss target views."""

    def render(self, stage: Stage[EstimatedLatent]) -> StageRendering:
        """Render all views of every scene."""
        return self.render_views(stage, self.batch.images.shape[1])


def code_with_additive_noise(receiver: Receiver, sender: Sender) -> Coding:
    """Return the paper's latent coder: uniform noise replaces rounding, for g_s and for the rate."""

    def code(y: Tensor, inputs: StageInputs) -> EstimatedLatent:
        z = sender.hyper_analysis(y)
        estimate = estimate_latents(
            receiver.prior, y, z, inputs.lambda_q, inputs.stage, inputs.y_hat, additive_noise(uniform_noise())
        )
        return EstimatedLatent(estimate.y_hat, estimate.bits_y + estimate.bits_z)

    return code


def run_paper_stages(
    sender: Sender,
    receiver: Receiver,
    batch: Batch,
    coding: Coding,
    num_stages: int,
    extracted: Extracted | None = None,
) -> list[RatedStage]:
    """Code, decode and render a batch; returns the results per stage. extracted: see `BatchEncoder`."""
    encoder = PaperBatchEncoder(sender, receiver, batch, extracted)
    num_pixels = encoder.num_pixels / len(batch.images)
    stages = encoder.run(batch.lambda_q, num_stages, coding)
    renderings = [stage.feedback for stage in stages[1:] if stage.feedback is not None] + [encoder.render(stages[-1])]
    return [
        RatedStage(
            torch.stack([scene.color for scene in rendering.scenes]),
            rearrange(stage.coded.bits, "(b v) -> b v", v=encoder.num_views).sum(dim=1) / num_pixels,
        )
        for stage, rendering in zip(stages, renderings, strict=True)
    ]


def paper_loss(
    batch: Batch, stages: list[RatedStage], distortion: Distortion
) -> tuple[Float[Tensor, ""], dict[str, float]]:
    """Return the loss and its parts for the log (paper, training strategy).

    The loss is the sum over stages of lambda R_k plus the sum of D over all target views; mean over the batch.
    """
    num_context, total = batch.num_context, batch.images.new_zeros(())
    parts: dict[str, Tensor] = {}
    for number, stage in enumerate(stages, start=1):
        targets = batch.images[:, num_context:]
        rendering_loss = distortion(stage.images[:, num_context:], targets).sum(dim=1)
        total = total + (lambda_of(batch.lambda_q) * stage.rate + rendering_loss).mean()
        squared = (stage.images.detach() - batch.images).square().mean(dim=(0, 2, 3, 4))
        parts |= {
            f"mse{number}": squared[num_context:].mean(),
            f"mse_context{number}": squared[:num_context].mean(),
            f"bpp{number}": stage.rate.mean(),
        }
    return total, {name: float(value.detach()) for name, value in parts.items()}
