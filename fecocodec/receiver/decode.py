"""Decode a `.fcs` stream to Gaussians, with the receiver's networks alone."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import torch
from torch import Tensor

from fecocodec.checkpoint import find_receiver
from fecocodec.coding.camera_packing import unpack
from fecocodec.coding.detail import detail_values
from fecocodec.coding.payload import decode_latents
from fecocodec.coding.visibility import is_filled_behind, visibility_of
from fecocodec.config import ReceiverConfig
from fecocodec.container import (
    Detail,
    IntactPart,
    Stages,
    Stream,
    check_pixels,
    check_symbol_digest,
    decode_stages,
    read_stages,
)
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.normalisation import denormalise_gaussians, normalise_scene
from fecocodec.grid import LATENTS
from fecocodec.layers.memory_format import to_channels_last
from fecocodec.limits import DEFAULT_MAX_PIXELS, MAX_SH_DEGREE
from fecocodec.merging.grouping import DEFAULT_MERGING, MergingConfig
from fecocodec.progress import OnProgress, ignore_progress
from fecocodec.receiver.model import Receiver, load_receiver
from fecocodec.receiver.state import State
from fecocodec.splatting.background import DEFAULT_BACKGROUND, BackgroundConfig
from fecocodec.splatting.emission import Emission, Prediction, emit

_Known = tuple[State, Tensor]  # after a stage: S_k, y_hat_k


@dataclass(frozen=True)
class Decoded:
    """A decoded scene.

    gaussians: in the world frame and unit of length of the cameras, on the CPU. cameras: of the context views.
    image_size: (height, width) of the context views in pixels. stages: number of stages decoded, 1 or 2.
    damage: error message about the rest of the stream, None for an intact stream.
    """

    gaussians: Gaussians
    cameras: Cameras
    image_size: tuple[int, int]
    stages: int
    damage: str | None


def decode(
    data: bytes,
    *,
    stages: Stages = "all",
    sh_degree: int = MAX_SH_DEGREE,
    background: BackgroundConfig | None = DEFAULT_BACKGROUND,
    merging: MergingConfig | None = DEFAULT_MERGING,
    device: str = "cpu",
    model: Path | str | None = None,
    max_pixels: int = DEFAULT_MAX_PIXELS,
    on_progress: OnProgress = ignore_progress,
) -> Decoded:
    """Decode a `.fcs` stream with torch; arguments and errors as for `decoding.decode`, which chooses the receiver.

    background: parameters of the layer that fills what no context view shows; None for no layer. merging: parameters
    for merging similar neighbouring Gaussians; None keeps all on their grid. device: torch device of the networks.
    """
    part = read_stages(data, stages)
    check_pixels(part.stream.header, max_pixels)
    receiver = receiver_of(part.stream.header.model_id, None if model is None else Path(model).absolute(), device)
    emission = emission_of(sh_degree, background, merging)
    return _predicted(receiver, part, stages, on_progress).decoded(emission)


def decode_with(
    receiver: Receiver,
    data: bytes,
    *,
    stages: Stages = "all",
    sh_degree: int = MAX_SH_DEGREE,
    background: BackgroundConfig | None = DEFAULT_BACKGROUND,
    merging: MergingConfig | None = DEFAULT_MERGING,
    on_progress: OnProgress = ignore_progress,
) -> Decoded:
    """Decode with a loaded receiver, which must have the model id of the stream; otherwise as `decode` does."""
    part, emission = read_stages(data, stages), emission_of(sh_degree, background, merging)
    return _predicted(receiver, part, stages, on_progress).decoded(emission)


@lru_cache(maxsize=2)
def receiver_of(model_id: bytes, model: Path | None, device: str) -> Receiver:
    """Return the receiver with this model id, from the folder `model` or from the shipped models.

    The cache key includes the model id, because a replaced file has another id. Raises ModelError if no such receiver
    is found.
    """
    receiver, _ = load_receiver(find_receiver(model_id, model))
    to_channels_last(receiver, device)
    return receiver


@dataclass(frozen=True)
class PredictedScene:
    """A stream after the networks, from which Gaussians are emitted. stages, damage: as in `Decoded`."""

    stream: Stream
    cameras: Cameras
    prediction: Prediction
    config: ReceiverConfig
    stages: int
    damage: str | None

    def decoded(self, emission: Emission) -> Decoded:
        """Return what a decoder emits, with the coverage and fading of the stream."""
        header = self.stream.header
        visibility = visibility_of(self.stream, self.config.gaussians_per_side)
        factors = None if visibility is None else torch.from_numpy(visibility)
        is_filled = is_filled_behind(header.num_views, self.stream.coverage is not None)
        emission = replace(emission, visibility=factors, is_filled=emission.background is not None and is_filled)
        with torch.inference_mode():
            gaussians = emitted_gaussians(self.prediction, self.cameras, self.config, emission)
        # Clone outside inference mode, so that a caller can compute gradients of the tensors.
        gaussians = Gaussians(*(field.clone() for field in gaussians.fields()))
        return Decoded(gaussians, self.cameras, (header.height, header.width), self.stages, self.damage)


def predict_with(receiver: Receiver, data: bytes) -> PredictedScene:
    """Run the networks of a loaded receiver on all stages of a stream; arguments and errors as for `decode_with`."""
    return _predicted(receiver, read_stages(data, "all"), "all", ignore_progress)


@torch.inference_mode()
def _predicted(receiver: Receiver, part: IntactPart, stages: Stages, on_progress: OnProgress) -> PredictedScene:
    stream, header = part.stream, part.stream.header
    cameras = unpack(stream.cameras)
    device = next(receiver.parameters()).device
    height, width = header.grid_size
    size_8 = (header.num_views, height // LATENTS, width // LATENTS)

    def advance(stage: int, payload: bytes, before: _Known | None) -> _Known:
        state, context = before or (None, None)
        lambda_q = header.lambda_q_of_stage(stage)
        coded = decode_latents(receiver.prior, payload, size_8, lambda_q, stage, context)
        check_symbol_digest(header, stage, coded.digest())
        condition = receiver.condition(torch.full((header.num_views,), lambda_q, device=device), stage)
        start = receiver.update.start(header.num_views, 1, 1) if state is None else state.state
        return State(receiver.next_state(start, coded.y_hat, condition), condition), coded.y_hat

    def with_detail(detail: Detail, before: _Known) -> _Known:
        tables = None if receiver.detail is None else receiver.detail.tables.cpu().numpy()
        values = torch.from_numpy(detail_values(tables, detail, header)).to(device)
        return replace(before[0], detail=values), before[1]

    (state, _), num_stages, symbol_damage = decode_stages(stream, stages, advance, with_detail, on_progress)
    on_progress("predicting Gaussians", 0.8)
    prediction = _prediction(receiver, state, cameras)
    return PredictedScene(stream, cameras, prediction, receiver.config, num_stages, part.damage or symbol_damage)


def reconstruct(receiver: Receiver, state: State, cameras: Cameras, emission: Emission) -> Gaussians:
    """Return the Gaussians of a state, on the CPU, in the frame and unit of `cameras`, the stored context views."""
    return emitted_gaussians(_prediction(receiver, state, cameras), cameras, receiver.config, emission)


def _prediction(receiver: Receiver, state: State, cameras: Cameras) -> Prediction:
    of_scene = normalise_scene(cameras)[0].to(state.state.device).as_batch()
    return receiver.predict(state.state, of_scene, state.condition, state.detail)


def emitted_gaussians(
    prediction: Prediction, cameras: Cameras, config: ReceiverConfig, emission: Emission
) -> Gaussians:
    """Return the Gaussians of a prediction, as `reconstruct` does."""
    normalised, frame = normalise_scene(cameras)
    device = prediction.relative_disparity.device
    if emission.visibility is not None:
        emission = replace(emission, visibility=emission.visibility.to(device))
    emitted = emit(prediction, normalised.to(device).as_batch(), config, emission)
    return denormalise_gaussians(emitted.to("cpu"), frame)


def emission_of(
    sh_degree: int = MAX_SH_DEGREE,
    background: BackgroundConfig | None = DEFAULT_BACKGROUND,
    merging: MergingConfig | None = DEFAULT_MERGING,
) -> Emission:
    """Return what a decoder emits. Raises InputError for a degree of the harmonics that is not supported."""
    if sh_degree not in range(MAX_SH_DEGREE + 1):
        raise InputError(f"spherical harmonics of degree {sh_degree} are not supported; choose 0 to {MAX_SH_DEGREE}.")
    return Emission(sh_degree=sh_degree, is_culled=True, background=background, merging=merging)
