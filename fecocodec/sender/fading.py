"""Fade parts of views whose Gaussians stand as fog before what other views show (FORMAT.md, section 8.2).

The opacities of the Gaussians of a block are multiplied by a factor. A few steps of Adam raise the quality of all
photographs by these factors, which are then rounded to the levels of the format. A step renders every second coded
photograph and some guides; a coded one is rendered in turn from all Gaussians and from those of the other views alone,
because its own Gaussians are in front of those of others.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import fmean

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from fecocodec.coding.visibility import FACTOR_OF_LEVEL, pack_levels
from fecocodec.container import FADING_BLOCKS
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import joined_masks
from fecocodec.progress import Progress
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.coverage import BLACK
from fecocodec.sender.scene import Guides

LEAST_VIEWS = 5  # with fewer views that fit, factors fit the photographs and not what is between them
# Chosen on captures that the weights were not trained on (docs/what_we_learned.md, More views).
NUM_STEPS, NUM_STEPS_OF_FEW = 4, 6
# dB of the coded photographs, for which few views fade. Of 30 sets with a view that none confirms, new views of the
# three that gain so much are 0.05 to 0.24 dB better, those of the others -0.2 to 0.5; of a dev entry, 2.4 dB worse.
LEAST_GAIN_OF_FEW = 0.25
ADDED_ERROR = 1e-10  # to the mean squared error: the PSNR is at most 100 dB, with a finite gradient
GUIDES_OF_STEP = 4  # about; more take turns
STEP = 1.5  # learning rate of Adam, for the logits of the factors
LEAST_SLOPE = 1e-3  # dB: epsilon of Adam. Blocks whose slopes are smaller change little
FIRST_LOGIT = 3.0  # of an unfaded block
HIDDEN_LOGIT = -40.0  # of a block that is left out; no step changes it
MAX_PIXELS = 2**21  # of all views; the time grows with the pixels times the views


@dataclass(frozen=True)
class Fading:
    """Factors of the opacities of the Gaussians of one scene.

    logits: of each block, relative to those of an unfaded block.
    """

    logits: Float[Tensor, "view row column"]

    @property
    def levels(self) -> UInt8[Tensor, "view row column"]:
        """Return the levels of the format that are nearest to the factors."""
        highest = len(FACTOR_OF_LEVEL) - 1
        return (highest * (1.0 - _factors(self.logits))).round().to(torch.uint8)

    def factors(self, count: int) -> Float[Tensor, " n"]:
        """Return the factor of each of `count` Gaussians, as a decoder applies it."""
        factors = torch.from_numpy(FACTOR_OF_LEVEL).to(self.logits.device)[self.levels.long()]
        return _of_gaussians(factors, count)


def fading_of_masks(ignored: Bool[Tensor, "view h w"] | None) -> Fading | None:
    """Return the fading that leaves out each block of which masks mark every pixel; None if there is none."""
    if ignored is None:
        return None
    is_hidden = F.avg_pool2d(ignored.float(), FADING_BLOCKS.side) == 1.0
    return Fading(HIDDEN_LOGIT * is_hidden.float()) if bool(is_hidden.any()) else None


Fade = Callable[[Gaussians, Fading | None, Progress], Fading]  # (Gaussians after a stage, fading before it, progress)


def fader(
    images: Float[Tensor, "view 3 h w"],
    cameras: Cameras,
    background: tuple[float, float, float] = BLACK,
    ignored: Bool[Tensor, "view h w"] | None = None,
    guides: Guides | None = None,
    is_faded: Bool[Tensor, " view"] | None = None,
) -> Fade:
    """Return a function that finds the fading of a scene.

    images: sRGB in [0, 1], on the coding grid. cameras: normalised. background: behind the Gaussians, sRGB.
    ignored: pixels that do not count; None if all do. guides: photographs that are not coded. is_faded: which views
    have blocks that may fade; None for all.
    """
    size, num_guides = (images.shape[-2], images.shape[-1]), 0 if guides is None else guides.count
    are_few = len(images) < LEAST_VIEWS
    num_steps = NUM_STEPS_OF_FEW if are_few else NUM_STEPS
    turns = max(2, -(-num_guides // GUIDES_OF_STEP))
    pictures, cameras_of_all = images, cameras
    if guides is not None:
        pictures, cameras_of_all = torch.cat((images, guides.images)), cameras.joined(guides.cameras)
        ignored = joined_masks([(ignored, images), (guides.ignored, guides.images)])
    grid = (len(images), images.shape[-2] // FADING_BLOCKS.side, images.shape[-1] // FADING_BLOCKS.side)

    def quality(gaussians: Gaussians, view: int) -> Tensor:
        color = render(gaussians, cameras_of_all.select([view]), size, background).color.clamp(0, 1)
        of_view = None if ignored is None else ignored[[view]]
        return psnr(color, pictures[[view]], of_view, added_error=ADDED_ERROR)[0]

    def mean_quality(gaussians: Gaussians, fading: Fading) -> float:
        opacities = gaussians.opacities * fading.factors(gaussians.count)
        return fmean(float(quality(replace(gaussians, opacities=opacities), view)) for view in range(grid[0]))

    def fade(gaussians: Gaussians, before: Fading | None, progress: Progress = Progress()) -> Fading:  # noqa: B008
        before = Fading(images.new_zeros(grid)) if before is None else before
        logits = before.logits.clone()
        view = torch.arange(grid[0], device=images.device)[:, None, None]
        view_of = _of_gaussians(view.expand(grid), gaussians.count)
        adam = torch.optim.Adam([logits.requires_grad_()], lr=STEP, betas=(0.5, 0.9), eps=LEAST_SLOPE)
        for step in range(num_steps):
            progress("fading what hides other views", step / num_steps)
            adam.zero_grad()
            coded, taught = range(step % 2, grid[0], 2), range(grid[0] + step % turns, len(pictures), turns)
            for number in (*coded, *taught):
                is_shown = view_of != number
                if (step // 2 + number // 2) % 2 == 0:
                    is_shown[:] = True
                with torch.enable_grad():
                    factors = _of_gaussians(_factors(logits), gaussians.count)
                    opacities = (gaussians.opacities * factors)[is_shown]
                    weight = 2 if number < grid[0] else turns  # for those that this step does not render, too
                    loss = -weight * quality(replace(gaussians.keep(is_shown), opacities=opacities), number)
                    loss.backward()
            if is_faded is not None and logits.grad is not None:
                logits.grad[~is_faded] = 0.0
            adam.step()
        after = Fading(logits.detach().nan_to_num(0.0))
        is_kept = not are_few or mean_quality(gaussians, after) > mean_quality(gaussians, before) + LEAST_GAIN_OF_FEW
        return after if is_kept else before

    return fade


def fading_of(fading: Fading | None) -> bytes | None:
    """Return `Stream.fading`; None if no block is faded."""
    if fading is None or not bool(fading.levels.any()):
        return None
    return pack_levels(fading.levels.cpu().numpy())


def _factors(logits: Tensor) -> Tensor:
    """Return the factors of opacities in [0, 1]; 1 for a logit of zero or more."""
    return (torch.sigmoid(FIRST_LOGIT + logits) / torch.sigmoid(torch.tensor(FIRST_LOGIT))).clamp(max=1.0)


def _of_gaussians(values: Tensor, count: int) -> Tensor:
    """Return the value of the block of each Gaussian, ordered (view, row, column). values: [view row column]."""
    side = round((count / values.numel()) ** 0.5)  # Gaussians along a side of a block
    views, rows, columns = values.shape
    in_rows = values[..., None].expand(-1, -1, -1, side).reshape(views, rows, 1, columns * side)
    return in_rows.expand(-1, -1, side, -1).flatten()
