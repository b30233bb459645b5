"""`encode`: posed photographs -> stream."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.checkpoint import model_folder
from fecocodec.coding.visibility import visibility_of
from fecocodec.config import PAPER, ReceiverConfig
from fecocodec.container import EXCESS_UNIT, Header, Stream, dequantise_lambda, quantise_lambda, write_stream
from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.limits import MAX_SIDE, MAX_STAGES, MAX_VIEWS, MIN_SIDE
from fecocodec.receiver.decode import OnProgress
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.coverage import LEAST_OPACITY, coverage_of
from fecocodec.sender.detail_steps import find_detail
from fecocodec.sender.fading import LEAST_VIEWS, MAX_PIXELS, Fade, fader, fading_of
from fecocodec.sender.latent_coding import WrittenLatent, estimate_bits, write_latents
from fecocodec.sender.latent_optimisation import optimiser
from fecocodec.sender.optimisation_config import DEFAULT, OptimisationConfig, config_of_effort
from fecocodec.sender.scene import Scene, prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import Optimise, Stage, not_optimised
from fecocodec.sender.view_overlap import overlap_warnings, view_overlap

OnWarning = Callable[[str], None]  # (sentence)
SHARE_OF_DETAIL = 0.2  # of the time of an encoding, for progress


def encode(
    views: Views,
    *,
    lmbda: float = 1e-3,
    effort: str | OptimisationConfig = "default",
    sharpness: float = 0.0,
    num_stages: int = 2,
    device: str = "cpu",
    model: Path | str | None = None,
    on_progress: OnProgress = lambda _task, _fraction: None,
    on_warning: OnWarning = lambda _sentence: None,
) -> bytes:
    """Encode views to the bytes of a `.fcs` stream.

    lmbda: weight of the rate (bits per pixel) against the distortion, in [1e-5, 1e-2]; larger values give smaller
    files. effort: "fast", "default" or "best", or an `OptimisationConfig`; more effort gives a smaller file at equal
    quality; "fast" neither optimises latents nor fades what hides other views. sharpness: -1 to 1; more of it gives
    sharper pictures at the price of a larger file, see `OptimisationConfig`. num_stages: 1 omits the feedback stage.
    device: "cpu", "cuda" or "cuda:N". model: folder of the weights of sender and receiver, None for the default shipped
    model. on_progress: called with the name of the current step and the completed fraction. on_warning: called with a
    sentence about each view that does not fit the others.

    If `views` has `alpha`, the stream marks the transparent cells, and decoders emit no Gaussians for them.

    Raises InputError for views or options that cannot be encoded, ModelError if weights cannot be loaded.
    """
    lambda_q, config = quantise_lambda(lmbda), config_of_effort(effort, sharpness)
    check_views(views, num_stages)
    codec = load_codec(model_folder(model), device)
    return encode_with(codec, views, lambda_q, num_stages, config, on_progress, on_warning)


@torch.inference_mode(False)  # the optimisation needs gradients, which inference-mode tensors cannot have
@torch.no_grad()
def encode_with(
    codec: Codec,
    views: Views,
    lambda_q: int,
    num_stages: int = 2,
    config: OptimisationConfig = DEFAULT,
    on_progress: OnProgress = lambda _task, _fraction: None,
    on_warning: OnWarning = lambda _sentence: None,
) -> bytes:
    """Encode with loaded networks. lambda_q: quantised lambda, see `quantise_lambda`. Views must pass `check_views`.

    Raises InputError for cameras that a stream cannot represent.
    """
    scene = prepare_scene(views, codec.device)
    encoder = SceneEncoder.of(codec, scene)
    on_progress("matching views", 0.0)
    warn_of_overlap(encoder, views.names, on_warning)
    return write_scene(encoder, scene, lambda_q, num_stages, config, on_progress)


def write_scene(
    encoder: SceneEncoder,
    scene: Scene,
    lambda_q: int,
    num_stages: int,
    config: OptimisationConfig,
    on_progress: OnProgress = lambda _task, _fraction: None,
) -> bytes:
    """Return the bytes of the stream of one scene: its stages, then the detail layer if the model has one.

    With detail, stages are coded at `OptimisationConfig.latent_lambda_q`, because detail buys more with further bits.
    Raises InputError for a lambda outside the range of the model, and for a sharpness that it does not have.
    """
    receiver = encoder.codec.receiver
    check_lambda(receiver.config, lambda_q)
    if config.sharpness != 0.0 and encoder.codec.sender.sharp_steps is None:
        raise InputError("this model has no network for `sharpness`; leave it out, or choose another model.")
    detail_steps = config.detail_steps_of(encoder.num_views, encoder.num_pixels, lambda_q)
    has_detail = receiver.detail is not None and detail_steps > 0
    of_latents = config.latent_lambda_q(lambda_q) if has_detail else lambda_q
    share = 1.0 - SHARE_OF_DETAIL if has_detail else 1.0
    stages = write_stages(encoder, of_latents, num_stages, config, lambda task, done: on_progress(task, share * done))
    stream = assemble(encoder.codec, scene, stages)
    if not has_detail:
        return write_stream(stream)
    detail = find_detail(
        encoder,
        stages[-1],
        visibility_of(stream, receiver.config.gaussians_per_side),
        lambda_q,
        config,
        lambda done: on_progress("finding detail", share + SHARE_OF_DETAIL * done),
    )
    return write_stream(replace(stream, detail=detail))


def warn_of_overlap(encoder: SceneEncoder, names: tuple[str, ...], on_warning: OnWarning) -> None:
    """Call `on_warning` with a sentence about each view that does not fit the others, as matching shows."""
    disparity = encoder.matching.depth.relative_disparity
    overlap = view_overlap(encoder.images[0], disparity, encoder.cameras.scene(0))
    for sentence in overlap_warnings(overlap, names):
        on_warning(sentence)


def write_stages(
    encoder: SceneEncoder,
    lambda_q: int,
    num_stages: int,
    config: OptimisationConfig,
    on_progress: OnProgress = lambda _task, _fraction: None,
) -> tuple[Stage[WrittenLatent], ...]:
    """Optimise the latents of each stage of one scene and entropy-code them; fade blocks of many views.

    Nothing is faded without steps of optimisation. The method "paper" neither optimises nor fades, whatever `config`
    says, and a model that was trained with one stage codes one. Raises InputError for a lambda outside the range of the
    model.
    """
    model = encoder.codec.receiver.config
    check_lambda(model, lambda_q)
    num_stages = min(num_stages, model.num_stages)
    optimise: Optimise = not_optimised
    fade: Fade | None = None
    if model.method != PAPER:
        optimise = optimiser(encoder, config, estimate_bits(encoder.codec), lambda_q)
        if config.num_steps > 0 and encoder.num_views >= LEAST_VIEWS and encoder.num_pixels <= MAX_PIXELS:
            fade = fader(encoder.images[0], encoder.cameras.scene(0), encoder.background)
    return encoder.run(torch.tensor([lambda_q]), num_stages, write_latents(encoder.codec), optimise, fade, on_progress)


def check_lambda(model: ReceiverConfig, lambda_q: int) -> None:
    """Raise InputError for a quantised lambda outside the range that the model was trained for."""
    lowest, highest = (quantise_lambda(lmbda) for lmbda in model.lambda_range)
    if not lowest <= lambda_q <= highest:
        smallest, largest = model.lambda_range
        raise InputError(
            f"lambda is {dequantise_lambda(lambda_q):.2g}, but the model was trained for {smallest:g} to {largest:g}; "
            "choose a value in this range."
        )


def assemble(codec: Codec, scene: Scene, stages: tuple[Stage[WrittenLatent], ...]) -> Stream:
    """Return the stream with these coded stages, without detail."""
    digests = tuple(stage.coded.digest for stage in stages)
    first, last = (int(stage.inputs.lambda_q[0]) for stage in (stages[0], stages[-1]))
    excess = (first - last) // EXCESS_UNIT
    header = Header(codec.model_id, scene.num_views, *scene.image_size, last, digests, excess)
    payloads = tuple(stage.coded.payload for stage in stages)
    fading = fading_of(stages[-1].fading)
    coverage = coverage_of(scene.alpha, header)
    return Stream(header, scene.packed, payloads, coverage=coverage, fading=fading)


def check_views(views: Views, num_stages: int) -> None:
    """Raise InputError for views or a number of stages that cannot be encoded."""
    count, (height, width) = len(views.images), views.image_size
    if not 1 <= count <= MAX_VIEWS:
        raise InputError(f"{count} views were given; give 1 to {MAX_VIEWS}, chosen by `views`.")
    if views.cameras.num_views != count:
        raise InputError(f"{count} images were given with {views.cameras.num_views} cameras; give one camera an image.")
    if min(height, width) < MIN_SIDE or max(height, width) > MAX_SIDE:
        raise InputError(f"views are {width}x{height} pixels; sides must be {MIN_SIDE} to {MAX_SIDE}; change `size`.")
    if not 1 <= num_stages <= MAX_STAGES:
        raise InputError(f"{num_stages} stages were asked for; choose 1 or 2.")
    if not bool(views.images.isfinite().all()):
        raise InputError("a view holds values that are not finite; check the images.")
    if views.alpha is not None:
        _check_alpha(views.alpha, (count, height, width))


def _check_alpha(alpha: Float[Tensor, "*shape"], shape: tuple[int, int, int]) -> None:
    if tuple(alpha.shape) != shape:
        raise InputError(f"alpha has the shape {tuple(alpha.shape)}, the images need {shape}; give one value a pixel.")
    if not bool(alpha.isfinite().all()):
        raise InputError("alpha holds values that are not finite; check the images.")
    if not bool((alpha >= LEAST_OPACITY).any()):
        raise InputError(
            "every pixel of the views is transparent; correct the images, or ignore their opacity by a `background`."
        )
