"""The steps that encoding is made of: what the lambda search, the ablations and the plain encoder have in common.

Nothing before `analyse` depends on lambda, so a `PreparedScene` and its matched features serve any number of encodings.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.coding.camera_packing import pack, unpack
from fecocodec.coding.payload import CodedLatents, encode_latents
from fecocodec.container import EXCESS_UNIT, PackedCameras
from fecocodec.container.camera_rules import check_cameras
from fecocodec.errors import BitstreamError, InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.coding_grid import resample_to_grid
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.geometry.views import Views
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.state import State
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.matched_depth import MatchedDepth, depth_feedback
from fecocodec.sender.model import Sender

FIRST_STAGE_EXCESS = 229  # 256 ln 6, in units of the header


@dataclass(frozen=True)
class Profile:
    """The networks of both ends on one device, and the receiver's model id."""

    sender: Sender
    receiver: Receiver
    model_id: bytes


@dataclass(frozen=True)
class PreparedScene:
    """What the sender works from: images on the coding grid, and the cameras that the receiver will have.

    packed: cameras as a stream holds them. cameras: the same, normalised. image_size: (height, width) of the views as
    given, before they were resampled to the coding grid.
    """

    packed: PackedCameras
    cameras: Cameras
    images: Float[Tensor, "view 3 h w"]
    image_size: tuple[int, int]

    @property
    def num_views(self) -> int:
        return len(self.images)

    @property
    def size_4(self) -> tuple[int, int]:
        """(height, width) of features and states."""
        return self.images.shape[-2] // 4, self.images.shape[-1] // 4

    def lambda_of_views(self, lambda_q: int) -> Int[Tensor, " view"]:
        return torch.full((self.num_views,), lambda_q, device=self.images.device)


@dataclass(frozen=True)
class MatchedViews:
    """What matching the views against each other gives: F1, and the depth that the second stage compares with."""

    features: Float[Tensor, "view channel h4 w4"]
    depth: MatchedDepth


@dataclass(frozen=True)
class StageRendering:
    """The context views as the receiver could render them after a stage, and the depth it predicted for them."""

    color: Float[Tensor, "view 3 h w"]
    relative_disparity: Float[Tensor, "view 1 h4 w4"]


@dataclass(frozen=True)
class Latents:
    """y and z of one stage before coding."""

    y: Float[Tensor, "view latent h8 w8"]
    z: Float[Tensor, "view hyper h32 w32"]


@dataclass(frozen=True)
class CodedStage:
    """Bytes of one stage, and what both ends know after it.

    lambda_q: what it was coded at. after: the states of all views.
    """

    payload: bytes
    lambda_q: int
    latents: CodedLatents
    after: State

    @property
    def state(self) -> Float[Tensor, "view channel h4 w4"]:
        return self.after.state


def prepare(profile: Profile, views: Views) -> PreparedScene:
    """Views as the networks take them, on their device. Raises InputError for cameras that a stream cannot hold."""
    packed = _pack_checked(views.cameras)
    normalised, _ = normalise_scene(unpack(packed))
    device = next(profile.receiver.parameters()).device
    images = resample_to_grid(views.images.float().clone()).to(device)
    return PreparedScene(packed, normalised.to(device), images, views.image_size)


def first_stage_lambda_q(lambda_q: int) -> int:
    """At what stage 1 is coded where stage 2 follows at `lambda_q`: six times that lambda.

    What stage 1 gets wrong stage 2 sees and mends, so its bits are worth less (docs/experiments.md).
    """
    return lambda_q + EXCESS_UNIT * FIRST_STAGE_EXCESS


def start_state(profile: Profile, scene: PreparedScene) -> Float[Tensor, "view channel h4 w4"]:
    """S0, what the receiver knows before the first byte."""
    return profile.receiver.update.start(scene.num_views, *scene.size_4)


def match_views(profile: Profile, scene: PreparedScene) -> MatchedViews:
    """What stage 1 extracts from the views, and stage 2 goes back to."""
    extractor, images = profile.sender.extractor, scene.images[None]
    matching = extractor.match(images, scene.cameras.as_batch())
    return MatchedViews(extractor.fuse(images, matching), matching.depth)


def stage_rendering(profile: Profile, scene: PreparedScene, after: State) -> StageRendering:
    """What the receiver could show of the context views after that stage."""
    prediction = profile.receiver.predict(after.state, scene.cameras.as_batch(), after.condition)
    size = (scene.images.shape[-2], scene.images.shape[-1])
    color = render(profile.receiver.appearance(prediction, scene.cameras), scene.cameras, size).color
    return StageRendering(color, prediction.relative_disparity[0][:, None])


def feedback_features(
    profile: Profile, scene: PreparedScene, matched: MatchedDepth, rendering: StageRendering, lambda_q: int
) -> Float[Tensor, "view channel h4 w4"]:
    """F2: what stage 1's Gaussians make of the views, compared with the views and with the depth matched in them."""
    condition = profile.receiver.condition(scene.lambda_of_views(lambda_q), 2)
    depth_errors = depth_feedback(matched, rendering.relative_disparity)
    features: Tensor = profile.sender.feedback(scene.images, rendering.color, depth_errors, condition)
    return features


def analyse(
    profile: Profile,
    features: Float[Tensor, "view channel h4 w4"],
    state: Float[Tensor, "view channel h4 w4"],
    lambda_q: int,
    stage: int,
) -> Latents:
    """y = g_a(concat(F, S)) and z = h_a(y); state is what the receiver knows before this stage."""
    lambdas = torch.full((len(features),), lambda_q, device=features.device)
    y = profile.sender.analysis(features, state, profile.receiver.condition(lambdas, stage))
    return Latents(y, profile.sender.hyper_analysis(y))


def code_stage(
    profile: Profile,
    scene: PreparedScene,
    latents: Latents,
    lambda_q: int,
    before: CodedStage | None,
) -> CodedStage:
    """Latents of all views to bytes, and the states they lead to.

    before: the first stage where this is the second, None for the first.
    """
    receiver, stage = profile.receiver, 1 if before is None else 2
    context = None if before is None else before.latents.y_hat
    payload, coded = encode_latents(receiver.prior, latents.y, latents.z, lambda_q, stage, context)
    after = before.after if before else None
    after = receiver.advance(after, coded.y_hat, scene.lambda_of_views(lambda_q), stage)
    return CodedStage(payload, lambda_q, coded, after)


def _pack_checked(cameras: Cameras) -> PackedCameras:
    """Cameras as a stream holds them, checked before any work goes into them."""
    packed = pack(cameras)
    try:
        check_cameras(packed, "the views' cameras")
    except BitstreamError as error:
        raise InputError(str(error)) from error
    return packed
