"""`decode`: stream -> Gaussians, with the receiver's networks alone."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import torch

from fecocodec.checkpoint import SHIPPED, find_receiver
from fecocodec.coding.camera_packing import unpack
from fecocodec.coding.kept_cells import is_in_kept_cell
from fecocodec.coding.payload import decode_latents
from fecocodec.container import Header, Keep, Stream, read_prefix, read_stream
from fecocodec.errors import BitstreamError, InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.normalisation import denormalise_gaussians, normalise_scene
from fecocodec.geometry.padding import inside_unpadded, pad_cameras, padded_size
from fecocodec.layers.placement import place
from fecocodec.receiver.load import load_receiver
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.view_states import ViewStates, select_context, update_views

OnProgress = Callable[[str, float], None]  # (what is being done, fraction done)
LEAST_OPACITY = 1.0 / 255.0  # renderers skip fainter Gaussians; they are not emitted
LATENT_FACTOR = 8
MAX_SH_DEGREE = 1


def decode(
    data: bytes,
    *,
    num_stages: int | None = None,
    sh_degree: int = MAX_SH_DEGREE,
    device: str = "cpu",
    weights: str | Path = SHIPPED,
    on_progress: OnProgress = lambda _task, _fraction: None,
) -> Gaussians:
    """Gaussians of a `.fcs` stream in the world frame and unit of length of the photographs' cameras, on the CPU.

    num_stages: decode only so many stages; what follows them in the stream may then be missing or damaged.
    sh_degree: 1 for colours that depend on the direction, 0 for colours that do not, which take less room. device:
    where the networks run. weights: folder of the model, or of several.

    Raises BitstreamError for a stream that breaks a rule of the format, InputError for a stage it does not have and for
    another sh_degree, ModelError where its weights are not found.
    """
    stream = read_stream(data) if num_stages is None else read_prefix(data, num_stages)
    receiver = receiver_of(stream.header.model_id, weights, device)
    return decode_stream(stream, receiver, on_progress, sh_degree)


def read_cameras(data: bytes) -> tuple[Cameras, tuple[int, int]]:
    """The context views' cameras that a stream carries, and their image size (height, width)."""
    stream = read_prefix(data, 1)
    return unpack(stream.cameras), (stream.header.height, stream.header.width)


def decode_stream(
    stream: Stream,
    receiver: Receiver,
    on_progress: OnProgress = lambda _task, _fraction: None,
    sh_degree: int = MAX_SH_DEGREE,
) -> Gaussians:
    """Walk the stages of a stream that has been read, then predict; no rendering, no stage-1 Gaussians."""
    if sh_degree not in range(MAX_SH_DEGREE + 1):
        raise InputError(f"spherical harmonics of degree {sh_degree} were asked for; choose 0 or {MAX_SH_DEGREE}.")
    gaussians = _walk_and_predict(stream, receiver, on_progress, sh_degree)
    # A copy made outside inference mode is an ordinary tensor, which a caller may go on to refine.
    return Gaussians(*(field.clone() for field in gaussians.fields()))


@torch.inference_mode()
def _walk_and_predict(stream: Stream, receiver: Receiver, on_progress: OnProgress, sh_degree: int) -> Gaussians:
    header = stream.header
    device = next(receiver.parameters()).device
    height, width = padded_size(header.height, header.width)
    states: ViewStates | None = None
    context = None
    for stage, payload in enumerate(stream.payloads, start=1):
        on_progress(f"decoding stage {stage}", 0.4 * (stage - 1))
        views, lambda_q = header.views_of_stage(stage), header.lambda_q_of_stage(stage)
        size_8 = (len(views), height // LATENT_FACTOR, width // LATENT_FACTOR)
        coded = decode_latents(receiver.prior, payload, size_8, lambda_q, stage, select_context(context, views))
        _check_digest(header, stage, coded.digest())
        lambdas = torch.full((header.num_views,), lambda_q, device=device)
        states, context = update_views(receiver, states, coded.y_hat, lambdas, stage, views), coded.y_hat
    assert states is not None  # a stream has a stage
    on_progress("predicting Gaussians", 0.8)
    return predict_scene(receiver, states, unpack(stream.cameras), header, stream.keep, sh_degree)


def predict_scene(
    receiver: Receiver,
    states: ViewStates,
    cameras: Cameras,
    header: Header,
    keep: Keep | None,
    sh_degree: int = MAX_SH_DEGREE,
) -> Gaussians:
    """The Gaussians that the states stand for, without those of the padding, those too faint to be drawn, and those
    that `keep` leaves out; on the CPU.
    """
    normalised, frame = normalise_scene(cameras)
    padded = pad_cameras(normalised, header.height, header.width).to(states.state.device)
    prediction = receiver.predict(states.state, padded.as_batch(), states.condition)
    gaussians = (receiver.appearance(prediction, padded) if sh_degree else prediction.gaussians.scene(0)).to("cpu")
    is_drawable = (gaussians.opacities >= LEAST_OPACITY) & gaussians.means.isfinite().all(dim=-1)
    is_needed = inside_unpadded(header.num_views, header.height, header.width) & is_drawable
    if keep is not None:
        is_needed &= (gaussians.opacities >= keep.opacity_threshold / 255.0) & is_in_kept_cell(keep, header)
    return denormalise_gaussians(gaussians.keep(is_needed), frame)


@lru_cache(maxsize=2)
def receiver_of(model_id: bytes, weights: str | Path, device: str) -> Receiver:
    """The receiver of that id, found among `weights`; raises ModelError where it is not there.

    It is kept by model id, not by path: a file that was replaced is another model, and warm calls hash no weights.
    """
    receiver, _ = load_receiver(find_receiver(model_id, Path(weights)))
    place(receiver, device)
    return receiver


def _check_digest(header: Header, stage: int, found: bytes) -> None:
    stored = header.symbol_digests[stage - 1]
    if found != stored:
        raise BitstreamError(
            f"stage {stage}: the decoded symbols have digest {found.hex()}, the header says {stored.hex()}; "
            "the file is damaged or was made by a faulty encoder, copy or encode it again."
        )
