"""Scenes for depth completion: what matching finds in two views, and disparity that more views confirm.

A scene is matched twice: with its context views, as in encoding, and with further views, whose confirmed disparity is
the truth. Procedural scenes have exact depth.
"""

import random
from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from fecocodec.config import SenderConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth import relative_disparity_from_depth
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.sender.extractors.compact import CompactExtractor
from fecocodec.sender.extractors.depth_completion import MatchedMaps
from fecocodec.sender.extractors.dinov2 import dinov2_features
from fecocodec.sender.extractors.plane_extrapolation import extrapolate_planes
from fecocodec.training.samples import Sample

NUM_CONTEXT, NUM_FURTHER = 2, 4  # views
SOURCES_OF_TRUTH = 4  # nearest other views against which a view is matched for the truth
CONFIRMED, CONFIRMED_IN_CONTEXT = 0.7, 0.8  # consistency above which disparity is true
MIRRORED_SHARE, SINGLE_SHARE, HIDDEN_SHARE = 0.5, 0.06, 0.44  # of the scenes
BAND = (0.1, 0.45)  # width of a hidden band, as a share of the side
SIDE_OF_PATCH = (0.1, 0.5)  # likewise, of hidden rectangles
MOST_PATCHES = 3
SHIFT = (4, 20)  # of wrong matches in hidden regions, pixels at 1/4 resolution
LARGEST_NOISE = 0.3  # of the consistency of hidden pixels


@dataclass(frozen=True)
class CompletionScene:
    """Context views of a scene: what completion gets, and the truth; item = view, maps at 1/4 resolution.

    truth: relative disparity. is_known: where it holds.
    """

    maps: MatchedMaps
    images: UInt8[Tensor, "item 3 h w"]
    features: Float[Tensor, "item feature rows columns"]
    truth: Float[Tensor, "item 1 h4 w4"]
    is_known: Bool[Tensor, "item 1 h4 w4"]

    @property
    def photographs(self) -> Float[Tensor, "item 3 h w"]:
        """The images, sRGB in [0, 1]."""
        return self.images / 255.0


@torch.no_grad()
def completion_scene(extractor: CompactExtractor, sample: Sample) -> CompletionScene:
    """Match the views of a sample, of which the first `NUM_CONTEXT` are context views."""
    cameras, frame = normalise_scene(sample.views.cameras)
    images, own = sample.views.images, cameras.select(list(range(NUM_CONTEXT)))
    photographs = images[:NUM_CONTEXT]
    maps = extractor.matched_maps(photographs[None], own.as_batch(), extractor.config.num_source_views)
    if sample.depth is None:
        truth, is_known = _confirmed_disparity(extractor, images, cameras)
    else:
        exact = relative_disparity_from_depth(sample.depth[:NUM_CONTEXT].float() / frame.scale, own)
        truth = F.avg_pool2d(exact[:, None], 4)
        is_known = torch.ones_like(truth, dtype=torch.bool)
    stored = (255.0 * photographs).round().to(torch.uint8)
    return CompletionScene(maps, stored, dinov2_features(photographs).half(), truth, is_known)


def _confirmed_disparity(
    extractor: CompactExtractor, images: Float[Tensor, "view 3 h w"], cameras: Cameras
) -> tuple[Float[Tensor, "item 1 h4 w4"], Bool[Tensor, "item 1 h4 w4"]]:
    """Return disparity of the context views matched against all views, and where it is confirmed."""
    maps = extractor.matched_maps(images[None], cameras.as_batch(), SOURCES_OF_TRUTH)
    return maps.disparity[:NUM_CONTEXT], maps.consistency[:NUM_CONTEXT] > CONFIRMED


def varied(scene: CompletionScene, rng: random.Random) -> CompletionScene:
    """Return the scene, in half of the cases mirrored, and often without some or all of its matches."""
    if rng.random() < MIRRORED_SHARE:
        scene = _mirrored(scene)
    kind = rng.random()
    if kind < SINGLE_SHARE:
        return without_matches(scene)
    return with_hidden_regions(scene, rng) if kind < SINGLE_SHARE + HIDDEN_SHARE else scene


def without_matches(scene: CompletionScene, num_candidates: int = SenderConfig.num_candidates) -> CompletionScene:
    """Return the scene as matching finds a view alone: all depth candidates are equally likely."""
    half = torch.full_like(scene.truth, 0.5)
    maps = MatchedMaps(half, torch.zeros_like(half), torch.full_like(half, 1.0 / num_candidates), half)
    return replace(_with_matched_truth(scene), maps=maps)


def with_hidden_regions(scene: CompletionScene, rng: random.Random) -> CompletionScene:
    """Return the scene with wrong, hardly consistent matches in a band at a border or in rectangles of each view.

    Their disparity was confirmed, so it is known there.
    """
    maps, (height, width) = scene.maps, scene.truth.shape[-2:]
    is_hidden = torch.stack([_hidden_region(height, width, rng) for _ in scene.truth])[:, None]
    wrong = maps.disparity.flip(-1) if rng.random() < 0.5 else maps.disparity.roll(rng.randrange(*SHIFT), -1)
    noise = torch.full_like(maps.consistency, rng.uniform(0.0, LARGEST_NOISE))
    disparity = torch.where(is_hidden, wrong, maps.disparity)
    consistency = torch.where(is_hidden, noise, maps.consistency)
    confidence = torch.where(is_hidden, rng.uniform(0.3, 1.0) * maps.confidence, maps.confidence)
    extrapolated = extrapolate_planes(disparity, consistency, scene.photographs)
    hidden = MatchedMaps(disparity, consistency, confidence, extrapolated)
    return replace(_with_matched_truth(scene), maps=hidden)


def _hidden_region(height: int, width: int, rng: random.Random) -> Bool[Tensor, "h4 w4"]:
    """Return a band along one side of the image, or up to `MOST_PATCHES` rectangles."""
    is_hidden = torch.zeros(height, width, dtype=torch.bool)
    if rng.random() < 0.5:
        share = rng.uniform(*BAND)
        rows, columns = int(share * height), int(share * width)
        bands = (is_hidden[:, :columns], is_hidden[:, width - columns :], is_hidden[:rows], is_hidden[height - rows :])
        bands[rng.randrange(4)].fill_(True)
        return is_hidden
    for _ in range(rng.randint(1, MOST_PATCHES)):
        rows, columns = (int(rng.uniform(*SIDE_OF_PATCH) * side) for side in (height, width))
        top, left = rng.randrange(height - rows), rng.randrange(width - columns)
        is_hidden[top : top + rows, left : left + columns] = True
    return is_hidden


def _with_matched_truth(scene: CompletionScene) -> CompletionScene:
    """Return the scene with the disparity that the context views confirm as further truth."""
    is_confirmed = scene.maps.consistency > CONFIRMED_IN_CONTEXT
    truth = torch.where(scene.is_known, scene.truth, scene.maps.disparity)
    return replace(scene, truth=truth, is_known=scene.is_known | is_confirmed)


def _mirrored(scene: CompletionScene) -> CompletionScene:
    """Return the mirror image. The features of a mirrored photograph are nearly mirrored features."""
    maps = (scene.maps.disparity, scene.maps.consistency, scene.maps.confidence, scene.maps.extrapolated)
    return CompletionScene(
        MatchedMaps(*(field.flip(-1) for field in maps)),
        *(field.flip(-1) for field in (scene.images, scene.features, scene.truth, scene.is_known)),
    )
