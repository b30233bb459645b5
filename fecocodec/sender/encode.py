"""`encode`: posed photographs -> stream."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.checkpoint import DEFAULT_MODEL, RECEIVER_FILE, SENDER_FILE, SHIPPED
from fecocodec.coding.camera_packing import pack, unpack
from fecocodec.coding.payload import CodedLatents, encode_latents
from fecocodec.container import Header, PackedCameras, Stream, quantise_lambda, write_stream
from fecocodec.container.header import MAX_STAGES
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.geometry.padding import pad_cameras, pad_images
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import OnProgress
from fecocodec.receiver.load import load_receiver
from fecocodec.receiver.model import Receiver
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.load import load_sender
from fecocodec.sender.model import Sender

MAX_VIEWS = 16
MIN_SIDE, MAX_SIDE = 64, 1024


@dataclass(frozen=True)
class Profile:
    """The networks of both ends on one device, and the receiver's model id."""

    sender: Sender
    receiver: Receiver
    model_id: bytes


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
    _check(views, num_stages)
    return encode_with(load_profile(weights / model, device), views, lambda_q, num_stages, on_progress)


@lru_cache(maxsize=2)
def load_profile(folder: Path, device: str) -> Profile:
    """Both ends' networks from a model's folder."""
    receiver, model_id = load_receiver(folder / RECEIVER_FILE)
    sender = load_sender(folder / SENDER_FILE, receiver.config)
    for network in (sender, receiver):
        network.to(device, memory_format=torch.channels_last)
    return Profile(sender, receiver, model_id)


@torch.inference_mode()
def encode_with(
    profile: Profile,
    views: Views,
    lambda_q: int,
    num_stages: int,
    on_progress: OnProgress = lambda _task, _fraction: None,
) -> bytes:
    """Encode with networks that are loaded; the sender works from the cameras that the receiver will see."""
    sender, receiver = profile.sender, profile.receiver
    device = next(receiver.parameters()).device
    packed = pack(views.cameras)
    scene = _Scene.prepare(views, packed, device)
    on_progress("matching views", 0.1)
    features = sender.extractor(scene.images[None], scene.batch)
    state = receiver.update.start(*(features.shape[0], *features.shape[-2:]))
    lambdas = torch.full((len(scene.images),), lambda_q, device=device)
    payloads: list[bytes] = []
    coded: list[CodedLatents] = []
    for stage in range(1, num_stages + 1):
        condition = receiver.condition(lambdas, stage)
        if stage == 2:
            on_progress("rendering feedback", 0.5)
            features = sender.feedback(scene.images, _feedback(receiver, state, scene, lambdas), condition)
        on_progress(f"coding stage {stage}", 0.3 + 0.4 * (stage - 1))
        y = sender.analysis(features, state, condition)
        context = coded[-1].y_hat if coded else None
        payload, latents = encode_latents(receiver.prior, y, sender.hyper_analysis(y), lambda_q, stage, context)
        payloads.append(payload)
        coded.append(latents)
        state = receiver.next_state(state, latents.y_hat, condition)
    height, width = views.image_size
    digests = tuple(latents.digest() for latents in coded)
    header = Header(profile.model_id, len(views.images), height, width, lambda_q, digests)
    return write_stream(Stream(header, packed, tuple(payloads)))


@dataclass(frozen=True)
class _Scene:
    """Padded images and the normalised, padded cameras that the receiver will have."""

    images: Float[Tensor, "view 3 h w"]
    cameras: Cameras
    batch: Cameras  # the same with a batch dimension

    @classmethod
    def prepare(cls, views: Views, packed: PackedCameras, device: torch.device) -> "_Scene":
        normalised, _ = normalise_scene(unpack(packed))
        cameras = pad_cameras(normalised, *views.image_size).to(device)
        batch = Cameras(cameras.extrinsics[None], cameras.intrinsics[None], cameras.near[None], cameras.far[None])
        return cls(pad_images(views.images.float()).to(device), cameras, batch)


def _feedback(receiver: Receiver, state: Tensor, scene: _Scene, lambdas: Tensor) -> Float[Tensor, "view 3 h w"]:
    """What stage 1's Gaussians look like from the context views."""
    gaussians: Gaussians = receiver.predict(state, scene.batch, receiver.condition(lambdas, 1)).gaussians.scene(0)
    return render(gaussians, scene.cameras, (scene.images.shape[-2], scene.images.shape[-1])).color


def _check(views: Views, num_stages: int) -> None:
    count, (height, width) = len(views.images), views.image_size
    if not 1 <= count <= MAX_VIEWS:
        raise InputError(f"{count} views were given; give 1 to {MAX_VIEWS} (--views chooses some)")
    if min(height, width) < MIN_SIDE or max(height, width) > MAX_SIDE:
        raise InputError(f"views are {width}x{height} pixels; sides must be {MIN_SIDE} to {MAX_SIDE} (--size resizes)")
    if not 1 <= num_stages <= MAX_STAGES:
        raise InputError(f"{num_stages} stages were asked for; choose 1 or 2")
    if not bool(views.images.isfinite().all()):
        raise InputError("a view holds values that are not finite; check the images")
