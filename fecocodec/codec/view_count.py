"""How many photographs are coded: more of them as long as they gain more than finer coding of fewer would.

Each number is judged by a pass without optimisation at a small size: D over all photographs, coded or not, and the
bytes of the file.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import compress
from statistics import mean

import torch

from fecocodec.camera_files.posed_photographs import PosedPhotographs
from fecocodec.captures.chosen_photographs import framed
from fecocodec.captures.scene_folder import read_others, with_depth_bounds
from fecocodec.checkpoint import model_folder
from fecocodec.codec.options import EncodingOptions
from fecocodec.container import quantise_lambda
from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.limits import MIN_SIDE
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import load_codec
from fecocodec.sender.detail_steps import distortion
from fecocodec.sender.distortion import LogDistortion
from fecocodec.sender.encode import encoder_of, write_scene
from fecocodec.sender.lambda_roles import price_of_rate
from fecocodec.sender.optimisation_config import FAST
from fecocodec.sender.scene import Scene, prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.view_overlap import LEAST_CONFIRMED, view_overlap

COUNTS = (2, 3, 4, 6, 8, 12, 16)  # of coded views that are judged
JUDGED_PIXELS = 128 * 128  # of each photograph, about
# Of what coded views gain by finer coding, new views gain about this share (validation scenes: a quarter to a half).
SHARE_OF_NEW_VIEWS = 0.5


@dataclass(frozen=True)
class Judged:
    """A pass over a number of coded views. distortion: mean D over all photographs. bits_per_pixel: of coded views."""

    count: int
    distortion: float
    num_bytes: int
    bits_per_pixel: float


@torch.inference_mode(False)
@torch.no_grad()
def coded_views(
    scene: PosedPhotographs,
    options: EncodingOptions,
    on_note: Callable[[str], None],
    order: list[int],
    others: list[int],
) -> list[int]:
    """Return which photographs are coded. Candidates that no other photograph confirms are not.

    on_note: called with a sentence that says why not more. order: indices of candidates in the order in which they
    would be coded. others: photographs that can guide, too.
    Raises InputError for cameras that a stream cannot represent, ModelError if weights cannot be loaded.
    """
    views, indices = _read_small(scene, options, order, sorted({*order, *others}))
    codec, lambda_q = load_codec(model_folder(options.model), options.device), quantise_lambda(options.lmbda)

    @cache
    def matched(coded: tuple[int, ...]) -> tuple[SceneEncoder, Scene]:
        rest = [view for view in range(len(indices)) if view not in coded]
        guides = views.select(rest) if rest and options.guides != () else None
        small = prepare_scene(views.select(list(coded)), codec.device, guides)
        return encoder_of(codec, small), small

    candidates = tuple(indices.index(index) for index in order if index in indices)
    is_confirmed = _are_confirmed(matched(candidates)[0])
    candidates = tuple(compress(candidates, is_confirmed)) or candidates

    def judge(count: int) -> Judged:
        encoder, small = matched(candidates[:count])
        data = write_scene(encoder, small, lambda_q, options.num_stages, FAST)
        gaussians = decode_with(codec.receiver, data, merging=None).gaussians.to(codec.device)
        cameras = views.cameras.to(codec.device)
        rendered = render(gaussians, cameras, views.image_size).color.clamp(0, 1).cpu()
        loss = float(distortion(views.outside_masks(rendered), views.images).mean())
        return Judged(count, loss, len(data), 8 * len(data) / encoder.num_pixels)

    best, more = best_count(judge, len(candidates), lambda_q)
    if more is not None:
        on_note(_why_not(best, more))
    return [indices[view] for view in candidates[: best.count]]


def best_count(judge: Callable[[int], Judged], most: int, lambda_q: int) -> tuple[Judged, Judged | None]:
    """Return the best number of coded views, at most `most`, and the next larger one that was judged, if any.

    2, 4, 8 and 16 are judged, then those beside the best of these.

    Along a curve of rate and distortion, D of coded views falls by price * R for each e-fold of R, the mean bits of a
    pixel. More views must gain as much as finer coding does at new views: D + share * price * R * log(bytes) is least.
    """
    counts = sorted({count for count in COUNTS if count < most} | {most})
    judged = [judge(count) for count in counts if count in (most, *COUNTS[::2])]
    worth = SHARE_OF_NEW_VIEWS * price_of_rate(lambda_q) * mean(one.bits_per_pixel for one in judged)

    def best() -> Judged:
        return min(judged, key=lambda one: one.distortion + worth * math.log(one.num_bytes))

    place = counts.index(best().count)
    known = {one.count for one in judged}
    judged += [judge(count) for count in counts[max(0, place - 1) : place + 2] if count not in known]
    larger = [one for one in judged if one.count > best().count]
    return best(), min(larger, key=lambda one: one.count, default=None)


def _why_not(best: Judged, more: Judged) -> str:
    """Return a sentence that says what more coded views would give."""
    gain = (best.distortion - more.distortion) / LogDistortion.log_weight * 10 / math.log(10)
    return (
        f"{best.count} photographs are coded; {more.count} would take {more.num_bytes / best.num_bytes:.1f} times the "
        f"bytes for {gain:+.1f} dB over all photographs (estimated without optimisation)."
    )


def _are_confirmed(encoder: SceneEncoder) -> list[bool]:
    """Return which coded views other photographs confirm; others show another scene, or have a wrong camera."""
    disparity = encoder.matching.depth.relative_disparity
    overlap = view_overlap(encoder.images[0], disparity, encoder.cameras.scene(0), encoder.guides)
    is_confirmed: list[bool] = (overlap.confirmed.amax(dim=1) >= LEAST_CONFIRMED).tolist()
    return is_confirmed


def _read_small(
    scene: PosedPhotographs, options: EncodingOptions, order: list[int], indices: list[int]
) -> tuple[Views, list[int]]:
    """Return photographs at about JUDGED_PIXELS each, on white, and their indices, without those that cannot be read.

    All have the shape of the candidates, `order`.
    """
    height, width = framed(scene, [scene.photographs[index] for index in order], options.size, []).image_size
    scale = min(1.0, (JUDGED_PIXELS / (height * width)) ** 0.5)
    size = (max(MIN_SIDE, round(height * scale)), max(MIN_SIDE, round(width * scale)))
    chosen = framed(scene, [scene.photographs[index] for index in indices], size, [])
    views = read_others(chosen, background="white", masks=options.masks, on_left_out=lambda _sentence: None)
    if views is None:
        raise InputError(f"{scene.cameras_path}: none of its images can be read; check the images.")
    index_of = dict(zip(chosen.names, indices, strict=True))
    views = with_depth_bounds(chosen, views, options.near, options.far)
    return views, [index_of[name] for name in views.names]
