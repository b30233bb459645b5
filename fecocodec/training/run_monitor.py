"""What a training run measures and draws of itself: scores of validation scenes, and pictures of a few fixed scenes.

Scores come from streams that are encoded and decoded.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import fmean

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.container import dequantise_lambda
from fecocodec.container.lambda_quantisation import quantise_lambda
from fecocodec.geometry.cameras import Cameras, relative_disparity_from_depth
from fecocodec.limits import MAX_STAGES
from fecocodec.model_files import MODEL_ID_BYTES
from fecocodec.photographs.images import write_image
from fecocodec.receiver.decode import decode_with
from fecocodec.receiver.model import Receiver
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.perceptual import st_lpips
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with
from fecocodec.sender.model import Sender
from fecocodec.sender.optimisation_config import FAST
from fecocodec.training.batch import Batch, BatchShape
from fecocodec.training.processes import is_first
from fecocodec.training.run_files import append_lines
from fecocodec.training.samples import Sample
from fecocodec.training.sources import Sources, draw_batch
from fecocodec.training.trainer import Trainer
from fecocodec.training.training_pass import Coding, run_stages

_VALIDATION_SEED, _PICTURES_SEED = 21, 20
NUM_SCENES = 4  # of the pictures; half of them photographs, if there are any
SAMPLE_LAMBDA = 1e-4
VALIDATION_HEADER = "step\tlmbda\tbpp\tpsnr\tst_lpips"


@contextmanager
def weights_replaced(networks: nn.Module, weights: dict[str, Tensor]) -> Iterator[None]:
    """Give the networks other weights, a whole state dict, for the duration of the context."""
    before = {name: value.detach().clone() for name, value in networks.state_dict().items()}
    networks.load_state_dict(weights)
    try:
        yield
    finally:
        networks.load_state_dict(before)


@torch.no_grad()
def _score(codec: Codec, sample: Sample, lambda_q: int) -> tuple[float, float, float]:
    """Return bits of the stream per context pixel, PSNR (dB) and ST-LPIPS of the target views of one scene.

    Latents are not optimised. A model of three stages is measured with the two that a stream holds.
    """
    context = sample.views.select(list(range(sample.num_context)))
    data = encode_with(codec, context, lambda_q, MAX_STAGES, FAST)
    gaussians = decode_with(codec.receiver, data).gaussians.to(codec.device)
    targets = sample.views.select(list(range(sample.num_context, len(sample.views.images))))
    cameras = targets.cameras.to(codec.device)
    images = render(gaussians, cameras, targets.image_size).color.clamp(0.0, 1.0).cpu()
    height, width = context.image_size
    return (
        8 * len(data) / (sample.num_context * height * width),
        float(psnr(images, targets.images).mean()),
        float(st_lpips(images, targets.images).mean()),
    )


def draw_fixed_scenes(sources: Sources, size: tuple[int, int]) -> list[Batch]:
    """Draw scenes of two context views and a target view, equal in every run with the same sources."""
    generator = torch.Generator().manual_seed(_PICTURES_SEED)
    shape = BatchShape(num_scenes=1, num_context=2, num_target=1, size=size)
    lambda_q = quantise_lambda(SAMPLE_LAMBDA)
    shares = [float(index >= NUM_SCENES // 2) for index in range(NUM_SCENES)]
    return [draw_batch(sources, generator, shape, share, (lambda_q, lambda_q)) for share in shares]


@torch.no_grad()
def sample_grid(
    sender: Sender, receiver: Receiver, scenes: list[Batch], coding: Coding, num_stages: int
) -> Float[Tensor, "3 rows columns"]:
    """Return one row per scene: context views, target view, the target rendered after each stage, and the disparity of
    each rendering (bright is near, black is empty). sRGB in [0, 1].

    Does not change the state of torch's generators, so that training is equal with and without pictures.
    """
    device = scenes[0].images.device
    with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
        rows = [_grid_row(sender, receiver, scene, coding, num_stages) for scene in scenes]
    return torch.cat(rows, dim=1).clamp(0, 1)


def _grid_row(
    sender: Sender, receiver: Receiver, scene: Batch, coding: Coding, num_stages: int
) -> Float[Tensor, "3 height columns"]:
    target = scene.num_context
    outcomes, _ = run_stages(sender, receiver, scene, coding, num_stages)
    renderings = [outcome.renderings[0] for outcome in outcomes]
    colours = [rendering.color[target] for rendering in renderings]
    depths = torch.stack([rendering.depth[target] for rendering in renderings])
    return rearrange(
        torch.cat((scene.images[0, : target + 1], torch.stack(colours), _disparity(depths, scene.cameras.scene(0)))),
        "tile rgb height width -> rgb height (tile width)",
    )


def _disparity(depth: Float[Tensor, "stage height width"], cameras: Cameras) -> Float[Tensor, "stage 3 height width"]:
    """Return relative disparity: 0 at the far bound, 1 at the near bound, 0 where no Gaussian is drawn."""
    relative = relative_disparity_from_depth(depth.clamp_min(1e-6), cameras).clamp(0, 1)
    return torch.where(depth > 0, relative, 0.0)[:, None].expand(-1, 3, -1, -1)


class RunMonitor:
    """Measures and draws the present networks of a trainer. Its scenes are drawn at first use."""

    def __init__(self, trainer: Trainer) -> None:
        self.trainer = trainer
        self._validation_scenes: list[Sample] = []
        self._fixed_scenes: list[Batch] = []

    def validate(self) -> dict[str, float]:
        """Measure the validation scenes with the averaged weights, if there are any; returns columns of the log.

        Only the first process measures, at the ends and the middle of the range of lambda, scenes that are equal in
        every run. Scores by lambda go to `validation.txt`, separated by tabs; the log has the means over lambda.
        """
        trainer, settings = self.trainer, self.trainer.settings
        source, (lowest, highest) = trainer.sources.validation, settings.configuration.lambda_q_range
        if source is None or not is_first():
            return {}
        if not self._validation_scenes:
            shape, generator = settings.configuration.shapes.usual, torch.Generator().manual_seed(_VALIDATION_SEED)
            size = {"num_context": shape.num_context, "num_target": shape.num_target, "size": shape.size}
            self._validation_scenes = [
                source.sample(generator, **size)  # type: ignore[arg-type]
                for _ in range(settings.validation_scenes)
            ]
        rows = []
        with weights_replaced(trainer.networks, trainer.average):
            codec = Codec(trainer.sender, trainer.receiver, bytes(MODEL_ID_BYTES))  # an id that no model has
            for lambda_q in sorted({lowest, (lowest + highest) // 2, highest}):
                scores = [_score(codec, sample, lambda_q) for sample in self._validation_scenes]
                rows.append((dequantise_lambda(lambda_q), *map(fmean, zip(*scores, strict=True))))
        table = settings.folder / "validation.txt"
        lines = tuple("\t".join(f"{value:.6g}" for value in (trainer.step, *row)) for row in rows)
        append_lines(table, lines if table.exists() else (VALIDATION_HEADER, *lines))
        _, bpp, quality, distance = map(fmean, zip(*rows, strict=True))
        return {"val_psnr": quality, "val_st_lpips": distance, "val_bpp": bpp}

    def draw_samples(self) -> Path:
        """Render the fixed scenes with the present weights, write the image and return its path."""
        trainer, settings = self.trainer, self.trainer.settings
        if not self._fixed_scenes:
            scenes = draw_fixed_scenes(trainer.sources, settings.configuration.shapes.usual.size)
            self._fixed_scenes = [scene.to(settings.device) for scene in scenes]
        is_single = trainer.step < settings.configuration.schedule.one_stage_until
        num_stages = 1 if is_single else settings.configuration.receiver.num_stages
        grid = sample_grid(trainer.sender, trainer.receiver, self._fixed_scenes, trainer.coding, num_stages)
        path = settings.folder / "samples" / f"step_{trainer.step:06}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_image(path, grid.cpu(), overwrite=True)
        return path
