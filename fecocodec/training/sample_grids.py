"""Pictures of a few fixed scenes, rendered with the present networks, for monitoring a run."""

from pathlib import Path

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.container.lambda_quantisation import quantise_lambda
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth import relative_disparity_from_depth
from fecocodec.photographs.images import write_image
from fecocodec.receiver.model import Receiver
from fecocodec.sender.model import Sender
from fecocodec.training.batch import Batch
from fecocodec.training.batch_shapes import BatchShape
from fecocodec.training.dataset import Sources, draw_batch
from fecocodec.training.training_pass import Coding, run_stages

NUM_SCENES = 4  # half of them photographs, if there are any
SAMPLE_LAMBDA = 1e-4
_SEED = 20


def draw_fixed_scenes(sources: Sources, size: tuple[int, int]) -> list[Batch]:
    """Draw scenes of two context views and a target view, equal in every run with the same sources."""
    generator = torch.Generator().manual_seed(_SEED)
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
        return torch.cat([_row(sender, receiver, scene, coding, num_stages) for scene in scenes], dim=1).clamp(0, 1)


def write_sample_grid(folder: Path, step: int, grid: Float[Tensor, "3 rows columns"]) -> Path:
    """Write `samples/step_000123.png` to the folder of a run; returns its path."""
    path = folder / "samples" / f"step_{step:06}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_image(path, grid.cpu(), overwrite=True)
    return path


def _row(
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
