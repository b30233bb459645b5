"""`encode`: posed photographs -> stream."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.checkpoint import DEFAULT_MODEL, RECEIVER_FILE, SENDER_FILE, SHIPPED
from fecocodec.coding.camera_packing import pack, unpack
from fecocodec.coding.payload import CodedLatents, encode_latents
from fecocodec.container import Header, PackedCameras, Stream, quantise_lambda, write_stream
from fecocodec.container.camera_rules import check_cameras
from fecocodec.container.header import MAX_STAGES, MAX_VIEWS
from fecocodec.errors import BitstreamError, InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.geometry.padding import pad_cameras, pad_images
from fecocodec.geometry.views import Views
from fecocodec.layers.placement import place
from fecocodec.receiver.decode import OnProgress
from fecocodec.receiver.load import load_receiver
from fecocodec.receiver.model import Receiver
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.load import load_sender
from fecocodec.sender.model import Sender

MIN_SIDE, MAX_SIDE = 64, 1024


@dataclass(frozen=True)
class Profile:
    """The networks of both ends on one device, and the receiver's model id."""

    sender: Sender
    receiver: Receiver
    model_id: bytes


@dataclass(frozen=True)
class _Scene:
    """What the sender works from: padded images, and the normalised, padded cameras that the receiver will have."""

    images: Float[Tensor, "view 3 h w"]
    cameras: Cameras
    lambda_q: Int[Tensor, " view"]


def encode(
    views: Views,
    *,
    lmbda: float = 1e-3,
    num_stages: int = 2,
    device: str = "cpu",
    model: str = DEFAULT_MODEL,
    weights: Path = SHIPPED,
    on_progress: OnProgress = lambda _task, _fraction: None,
) -> bytes:
    """Bytes of a `.fcs` stream that `decode` turns into the Gaussians of these views.

    lmbda: price of a bit a pixel against squared error, in [1e-5, 1e-2]; larger means smaller files. num_stages: 1
    leaves the feedback stage out. model, weights: `<weights>/<model>/` holds the weights of both ends.

    Raises InputError for views or options that cannot be coded, ModelError where weights are missing.
    """
    lambda_q = quantise_lambda(lmbda)
    _check_views(views, num_stages)
    return encode_with(load_profile(weights / model, device), views, lambda_q, num_stages, on_progress)


@lru_cache(maxsize=2)
def load_profile(folder: Path, device: str) -> Profile:
    """Both ends' networks from a model's folder; raises ModelError where its files are missing, damaged or foreign."""
    receiver, model_id = load_receiver(folder / RECEIVER_FILE)
    sender = load_sender(folder / SENDER_FILE, receiver.config, model_id)
    for network in (sender, receiver):
        place(network, device)
    return Profile(sender, receiver, model_id)


@torch.inference_mode()
def encode_with(
    profile: Profile,
    views: Views,
    lambda_q: int,
    num_stages: int,
    on_progress: OnProgress = lambda _task, _fraction: None,
) -> bytes:
    """Encode with networks that are loaded; the sender works from the cameras that the receiver will see.

    Raises InputError for cameras that a stream cannot hold.
    """
    receiver = profile.receiver
    packed = _pack_checked(views.cameras)
    scene = _prepare(views, packed, lambda_q, next(receiver.parameters()).device)
    state = receiver.update.start(len(scene.images), scene.images.shape[-2] // 4, scene.images.shape[-1] // 4)
    payloads: list[bytes] = []
    coded: list[CodedLatents] = []
    for stage in range(1, num_stages + 1):
        on_progress(_TASKS[stage - 1], 0.1 + 0.4 * (stage - 1))
        features = _features(profile, scene, state, stage)
        on_progress(f"coding stage {stage}", 0.3 + 0.4 * (stage - 1))
        condition = receiver.condition(scene.lambda_q, stage)
        y = profile.sender.analysis(features, state, condition)
        context = coded[-1].y_hat if coded else None
        z = profile.sender.hyper_analysis(y)
        payload, latents = encode_latents(receiver.prior, y, z, lambda_q, stage, context)
        payloads.append(payload)
        coded.append(latents)
        state = receiver.next_state(state, latents.y_hat, condition)
    digests = tuple(latents.digest() for latents in coded)
    header = Header(profile.model_id, len(views.images), *views.image_size, lambda_q, digests)
    return write_stream(Stream(header, packed, tuple(payloads)))


_TASKS = ("matching views", "rendering feedback")


def _features(
    profile: Profile, scene: _Scene, state: Float[Tensor, "view channel h4 w4"], stage: int
) -> Float[Tensor, "view channel h4 w4"]:
    """What stage 1 extracts from the views, and stage 2 from what stage 1's Gaussians make of them."""
    sender, receiver = profile.sender, profile.receiver
    if stage == 1:
        features: Tensor = sender.extractor(scene.images[None], scene.cameras.as_batch())
        return features
    first = receiver.predict(state, scene.cameras.as_batch(), receiver.condition(scene.lambda_q, 1))
    size = (scene.images.shape[-2], scene.images.shape[-1])
    rendering = render(first.gaussians.scene(0), scene.cameras, size)
    features = sender.feedback(scene.images, rendering.color, receiver.condition(scene.lambda_q, stage))
    return features


def _prepare(views: Views, packed: PackedCameras, lambda_q: int, device: torch.device) -> _Scene:
    normalised, _ = normalise_scene(unpack(packed))
    return _Scene(
        images=pad_images(views.images.float()).to(device),
        cameras=pad_cameras(normalised, *views.image_size).to(device),
        lambda_q=torch.full((len(views.images),), lambda_q, device=device),
    )


def _pack_checked(cameras: Cameras) -> PackedCameras:
    """Cameras as a stream holds them, checked before any work goes into them."""
    packed = pack(cameras)
    try:
        check_cameras(packed, "the views' cameras")
    except BitstreamError as error:
        raise InputError(str(error)) from error
    return packed


def _check_views(views: Views, num_stages: int) -> None:
    count, (height, width) = len(views.images), views.image_size
    if not 1 <= count <= MAX_VIEWS:
        raise InputError(f"{count} views were given; give 1 to {MAX_VIEWS} (--views chooses some).")
    if views.cameras.num_views != count:
        raise InputError(f"{count} images were given with {views.cameras.num_views} cameras; give one camera an image.")
    if min(height, width) < MIN_SIDE or max(height, width) > MAX_SIDE:
        raise InputError(f"views are {width}x{height} pixels; sides must be {MIN_SIDE} to {MAX_SIDE} (--size resizes).")
    if not 1 <= num_stages <= MAX_STAGES:
        raise InputError(f"{num_stages} stages were asked for; choose 1 or 2.")
    if not bool(views.images.isfinite().all()):
        raise InputError("a view holds values that are not finite; check the images.")
