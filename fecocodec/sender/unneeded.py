"""Which Gaussians a receiver need not emit: those whose loss nobody would see.

The sender renders what the receiver will have at the context cameras and at cameras near them (so that new views do
not open holes), takes faint Gaussians and cells that contribute little away, and keeps what it may take within a bound.
"""

from dataclasses import dataclass

import torch
from einops import reduce
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.coding.kept_cells import cells_to_bits, is_in_kept_cell
from fecocodec.container import Header
from fecocodec.container.keep import CELL, Keep, cell_grid, pack_keep
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.nearby_cameras import nearby_cameras
from fecocodec.geometry.padding import inside_unpadded
from fecocodec.receiver.emission import LEAST_OPACITY
from fecocodec.rendering.contribution import contributions
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.steps import CodedStage, PreparedScene, Profile

LARGEST_LOSS = 0.001  # of the context views' squared error, which is 0.004 dB
THRESHOLDS = (4, 8, 12, 16, 24, 32, 48, 64)  # opacities in 255ths
SHARES_OF_CELLS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.45)
LARGEST_SHARE_OF_BYTES = 0.02  # of the stream, for saying which cells are left out
LEAST_SHARE_LEFT_OUT = 0.03  # of the Gaussians; a section that leaves out less is not worth its bytes
MOST_NEARBY = 4
LEAST_BYTES = 32  # a bitmap that leaves out anything takes about as much
_SIDE = CELL // 2  # Gaussians along a cell's side


@dataclass(frozen=True)
class _Trial:
    """What a subset of the Gaussians is judged by: cameras, and the pictures of all Gaussians there."""

    gaussians: Gaussians
    is_visible: Bool[Tensor, " n"]
    cameras: Cameras
    size: tuple[int, int]
    reference: Float[Tensor, "camera 3 h w"]
    allowed: float  # squared error


def choose_keep(
    profile: Profile, scene: PreparedScene, stages: tuple[CodedStage, ...], header: Header, num_bytes: int
) -> Keep | None:
    """The keep section for these stages, None where nothing is worth leaving out.

    num_bytes: of the stream without it.
    """
    trial = _trial(profile, scene, stages, header)
    if trial is None:
        return None
    threshold = _largest_threshold(trial)
    cells = _cells(trial, threshold, header, num_bytes)
    kept = _opaque(trial, threshold) & is_in_kept_cell(Keep(threshold, cells), header).to(trial.is_visible.device)
    is_worth_it = int(kept.sum()) <= (1.0 - LEAST_SHARE_LEFT_OUT) * int(trial.is_visible.sum())
    return Keep(threshold, cells) if is_worth_it else None


def _trial(profile: Profile, scene: PreparedScene, stages: tuple[CodedStage, ...], header: Header) -> _Trial | None:
    """None where the views have no cameras near them to be judged at."""
    nearby = nearby_cameras(scene.cameras, MOST_NEARBY)
    if nearby is None:
        return None
    last = stages[-1].after
    prediction = profile.receiver.predict(last.state, scene.cameras.as_batch(), last.condition)
    gaussians = profile.receiver.appearance(prediction, scene.cameras)
    inside = inside_unpadded(header.num_views, header.height, header.width).to(gaussians.opacities.device)
    is_visible = inside & (gaussians.opacities >= LEAST_OPACITY) & gaussians.means.isfinite().all(dim=-1)
    size = (scene.images.shape[-2], scene.images.shape[-1])
    cameras = Cameras(
        torch.cat((scene.cameras.extrinsics, nearby.extrinsics)),
        torch.cat((scene.cameras.intrinsics, nearby.intrinsics)),
        scene.cameras.near,
        scene.cameras.far,
    )
    reference = render(gaussians.keep(is_visible), cameras, size).color
    error = (reference[: scene.num_views] - scene.images).square().mean()
    return _Trial(gaussians, is_visible, cameras, size, reference, LARGEST_LOSS * float(error))


def _largest_threshold(trial: _Trial) -> int:
    """By halving: where a threshold is seen, every larger one is."""
    low, high = 0, len(THRESHOLDS)  # the first `low` thresholds go unseen, those from `high` on are seen
    while low < high:
        middle = (low + high) // 2
        if _is_unseen(trial, _opaque(trial, THRESHOLDS[middle])):
            low = middle + 1
        else:
            high = middle
    return THRESHOLDS[low - 1] if low else 0


def _opaque(trial: _Trial, threshold: int) -> Bool[Tensor, " n"]:
    return trial.is_visible & (trial.gaussians.opacities >= threshold / 255.0)


def _is_unseen(trial: _Trial, kept: Bool[Tensor, " n"]) -> bool:
    """Whether every one of the pictures stays as it was, up to the allowed squared error."""
    pictures = render(trial.gaussians.keep(kept), trial.cameras, trial.size).color
    changed = (pictures - trial.reference).square().mean(dim=(1, 2, 3))
    return float(changed.max()) <= trial.allowed


def _cells(trial: _Trial, threshold: int, header: Header, num_bytes: int) -> bytes | None:
    """The largest share of cells, least contribution first, that goes unseen and is cheap to say."""
    kept = _opaque(trial, threshold)
    if LARGEST_SHARE_OF_BYTES * num_bytes < LEAST_BYTES:
        return None
    weights = torch.zeros(len(kept), device=kept.device)
    weights[kept] = contributions(trial.gaussians.keep(kept), trial.cameras, trial.size).amax(dim=0)
    of_cell = _per_cell(weights, header, trial.size)
    best = None
    for share in SHARES_OF_CELLS:
        cells = of_cell > of_cell.flatten().sort().values[int(share * (of_cell.numel() - 1))]
        bits = cells_to_bits(cells)
        is_cheap = len(pack_keep(Keep(threshold, bits), header)) <= LARGEST_SHARE_OF_BYTES * num_bytes
        if not is_cheap or not _is_unseen(trial, kept & is_in_kept_cell(Keep(threshold, bits), header).to(kept.device)):
            break
        best = bits
    return best


def _per_cell(weights: Float[Tensor, " n"], header: Header, size: tuple[int, int]) -> Float[Tensor, "view row column"]:
    """Sum over the Gaussians of each cell; n counts those of the padded views' 1/2 grids."""
    views, rows, columns = cell_grid(header)
    grid = weights.view(views, size[0] // 2, size[1] // 2)[:, : _SIDE * rows, : _SIDE * columns]
    return reduce(grid, "view (row a) (column b) -> view row column", "sum", a=_SIDE, b=_SIDE)
