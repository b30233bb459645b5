"""How many photographs are coded: as many as it takes to show what all of them show.

Bytes grow with the number of coded views, and quality with the share of each photograph that the coded ones show.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import compress

import numpy as np
import torch
from jaxtyping import Float

from fecocodec.camera_files.posed_photographs import PosedPhotographs
from fecocodec.captures.chosen_photographs import framed
from fecocodec.captures.scene_folder import read_readable, with_depth_bounds
from fecocodec.checkpoint import model_folder
from fecocodec.codec.options import EncodingOptions
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras, depth_from_relative_disparity
from fecocodec.geometry.frustum_overlap import covisibility_estimate
from fecocodec.geometry.views import Views
from fecocodec.limits import MIN_SIDE
from fecocodec.sender.codec import load_codec
from fecocodec.sender.encode import encoder_of
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.view_overlap import LEAST_CONFIRMED

MATCHED_PIXELS = 128 * 128  # of each photograph, about, to find depth and photographs of another scene
LEAST_CONSISTENCY = 0.5  # of matched depth that counts
SHARE_OF_BOUNDS = (0.1, 0.9)  # of this depth that is nearer than the bounds of what photographs show
# Gain of the shown share that is worth twice the views. On six training captures, the numbers that follow from it were
# within 0.3 dB of the best at equal bytes; doubling the bytes by lambda gives new views about 0.6 dB.
GAIN_OF_DOUBLING = 0.03


@torch.inference_mode(False)
@torch.no_grad()
def coded_views(
    scene: PosedPhotographs,
    options: EncodingOptions,
    on_shares: Callable[[dict[int, float]], None],
    order: list[int],
    others: list[int],
) -> list[int]:
    """Return which photographs are coded. Candidates that no other photograph confirms are not.

    on_shares: called with the share that they show of each photograph, by its index. order: indices of candidates in
    the order in which they would be coded. others: photographs that can guide, too.
    Raises InputError for cameras that a stream cannot represent, ModelError if weights cannot be loaded.
    """
    views, indices = _read_small(scene, options, order, sorted({*order, *others}))
    candidates = [indices.index(index) for index in order if index in indices]
    rest = [view for view in range(len(indices)) if view not in candidates]
    codec = load_codec(model_folder(options.model), options.device)
    encoder = encoder_of(
        codec, prepare_scene(views.select(candidates), codec.device, views.select(rest) if rest else None)
    )
    candidates = list(compress(candidates, _are_confirmed(encoder))) or candidates
    shares = shown_shares(_with_matched_depth(views.cameras, encoder), candidates)
    count = best_count(shares.mean(axis=0))
    on_shares(dict(zip(indices, shares[:, count - 1].tolist(), strict=True)))
    return [indices[view] for view in candidates[:count]]


def shown_shares(cameras: Cameras, candidates: list[int]) -> Float[np.ndarray, "view candidate"]:
    """Return what the first candidate, the first two, and so on, show of each view: the largest overlap.

    cameras: of all views of a scene, with bounds of its depth.
    """
    bounds = float(cameras.near), float(cameras.far)
    overlap = covisibility_estimate(cameras.extrinsics.double().numpy(), cameras.intrinsics.double().numpy(), *bounds)
    shares: Float[np.ndarray, "view candidate"] = np.maximum.accumulate(overlap[:, candidates], axis=1)
    return shares


def best_count(shares: Float[np.ndarray, " candidate"]) -> int:
    """Return the number of coded views, two or more if there are as many, after which more views gain too little."""
    counts = range(min(2, len(shares)), len(shares) + 1)
    return max(counts, key=lambda count: shares[count - 1] - GAIN_OF_DOUBLING * math.log2(count))


def _with_matched_depth(cameras: Cameras, encoder: SceneEncoder) -> Cameras:
    """Return the cameras with bounds that hold most of the depth that matching confirms, if it confirms any."""
    matched, own = encoder.matching.depth, encoder.cameras.scene(0)
    depth = depth_from_relative_disparity(matched.relative_disparity[None, :, 0], own.as_batch())[0]
    confirmed = depth[matched.consistency[:, 0] > LEAST_CONSISTENCY].cpu()
    if not len(confirmed):
        return cameras
    near, far = cameras.near * torch.quantile(confirmed, torch.tensor(SHARE_OF_BOUNDS))
    return replace(cameras, near=near, far=far)


def _are_confirmed(encoder: SceneEncoder) -> list[bool]:
    """Return which coded views other photographs confirm; others show another scene, or have a wrong camera."""
    is_confirmed: list[bool] = (encoder.overlap.confirmed.amax(dim=1) >= LEAST_CONFIRMED).tolist()
    return is_confirmed


def _read_small(
    scene: PosedPhotographs, options: EncodingOptions, order: list[int], indices: list[int]
) -> tuple[Views, list[int]]:
    """Return photographs at about MATCHED_PIXELS each, on white, and their indices, without those that cannot be read.

    All have the shape of the candidates, `order`.
    """
    height, width = framed(scene, [scene.photographs[index] for index in order], options.size, []).image_size
    scale = min(1.0, (MATCHED_PIXELS / (height * width)) ** 0.5)
    size = (max(MIN_SIDE, round(height * scale)), max(MIN_SIDE, round(width * scale)))
    chosen = framed(scene, [scene.photographs[index] for index in indices], size, [])
    views, readable = read_readable(chosen, indices, options.masks)
    if views is None:
        raise InputError(f"{scene.cameras_path}: none of its images can be read; check the images.")
    return with_depth_bounds(chosen, views, options.near, options.far), readable
