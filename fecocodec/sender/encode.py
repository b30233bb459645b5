"""`encode`: posed photographs -> stream."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch
from jaxtyping import Bool
from torch import Tensor

from fecocodec.checkpoint import model_folder
from fecocodec.config import ReceiverConfig
from fecocodec.container import EXCESS_UNIT, Header, Stream, dequantise_lambda, quantise_lambda, write_stream
from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.progress import OnProgress, Progress, ignore_progress
from fecocodec.sender.ablations import without
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.coverage import coverage_of
from fecocodec.sender.detail_steps import find_detail
from fecocodec.sender.fading import LEAST_VIEWS, MAX_PIXELS, fader, fading_of
from fecocodec.sender.far_regions import far_factor, seen_through, with_far_regions
from fecocodec.sender.guide_check import check_guides, confirmed_guides, reason_of
from fecocodec.sender.lambda_roles import is_taught, lambda_of_latents
from fecocodec.sender.latent_optimisation import optimiser
from fecocodec.sender.optimisation_config import DEFAULT, OptimisationConfig, config_of_effort
from fecocodec.sender.scene import Scene, prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import NO_IMPROVEMENTS, Improvements, Stage, WrittenLatent, estimate_bits, write_latents
from fecocodec.sender.view_checks import check_views
from fecocodec.sender.view_overlap import LEAST_CONFIRMED, overlap_warnings

OnWarning = Callable[[str], None]  # (sentence)
OnOmission = Callable[[str, tuple[str, ...]], None]  # (sentence, names of guides that are left out)
TIME_OF_MATCHING, TIME_OF_DETAIL_STEP = 1.5, 0.6  # for progress, as in `sender/stages.py`


def encode(
    views: Views,
    *,
    lmbda: float = 1e-3,
    guides: Views | None = None,
    effort: str | OptimisationConfig = "default",
    sharpness: float = 0.0,
    num_stages: int = 2,
    device: str = "cpu",
    model: Path | str | None = None,
    on_progress: OnProgress = ignore_progress,
    on_warning: OnWarning = lambda _sentence: None,
    on_omission: OnOmission | None = None,
) -> bytes:
    """Encode views to the bytes of a `.fcs` stream.

    lmbda: weight of the rate (bits per pixel) against the distortion, in [1e-5, 1e-2]; larger values give smaller
    files. guides: photographs of the scene that are not coded, with cameras in the same world frame; the sender learns
    depth and appearance between the views from them. effort: "fast", "default" or "best", or an `OptimisationConfig`;
    more effort gives a smaller file at equal quality; "fast" neither optimises latents nor fades what hides other
    views. sharpness: -1 to 1; more of it gives sharper pictures at the price of a larger file, see
    `OptimisationConfig`. num_stages: 1 omits the feedback stage. device: "cpu", "cuda" or "cuda:N". model: folder of
    the weights of sender and receiver, None for the default shipped model. on_progress: called with the name of the
    current step and the completed fraction. on_warning: called with a sentence about each view that does not fit the
    others. on_omission: called with a sentence about guides that are left out, and their names.

    If `views` has `alpha`, the stream marks the transparent cells, and decoders emit no Gaussians for them. If views or
    guides have `ignored`, these pixels teach nothing, and blocks of them have no Gaussians.

    Raises InputError for views or options that cannot be encoded, ModelError if weights cannot be loaded.
    """
    lambda_q, config = quantise_lambda(lmbda), config_of_effort(effort, sharpness)
    check_views(views, num_stages, guides)
    codec = load_codec(model_folder(model), device)
    return encode_with(codec, views, lambda_q, num_stages, config, on_progress, on_warning, guides, on_omission)


@torch.inference_mode(False)  # the optimisation needs gradients, which inference-mode tensors cannot have
@torch.no_grad()
def encode_with(
    codec: Codec,
    views: Views,
    lambda_q: int,
    num_stages: int = 2,
    config: OptimisationConfig = DEFAULT,
    on_progress: OnProgress = ignore_progress,
    on_warning: OnWarning = lambda _sentence: None,
    guides: Views | None = None,
    on_omission: OnOmission | None = None,
) -> bytes:
    """Encode with loaded networks. lambda_q: quantised lambda, see `quantise_lambda`. Views must pass `check_views`.

    Raises InputError for cameras that a stream cannot represent.
    """
    on_progress("matching views", 0.0)
    encoder, scene = matched_scene(codec, views, guides, on_warning, on_omission)
    return write_scene(encoder, scene, lambda_q, num_stages, config, on_progress)


def matched_scene(
    codec: Codec,
    views: Views,
    guides: Views | None,
    on_warning: OnWarning,
    on_omission: OnOmission | None = None,
) -> tuple[SceneEncoder, Scene]:
    """Prepare the scene and match its views. Guides that matching does not confirm are left out.

    on_omission: as for `encode`. Raises InputError for cameras that a stream cannot represent.
    """
    on_omission = on_omission or (lambda sentence, _names: on_warning(sentence))
    if guides is not None and (guides.alpha is None) != (views.alpha is None):
        which = "are cut-outs and the guides are not" if guides.alpha is None else "are opaque and the guides are not"
        on_omission(f"the guides are left out: the coded views {which}.", guides.names)
        guides = None
    if not codec.receiver.config.kind.has_steps:
        guides = None  # the paper's method has no use for them
    scene = prepare_scene(views, codec.device, guides)
    encoder = encoder_of(codec, scene)
    has_far_regions = bool(seen_through(encoder).any())
    if has_far_regions and (factor := far_factor(encoder.cameras.scene(0))) > 1.0:
        views = replace(views, cameras=replace(views.cameras, far=factor * views.cameras.far))
        scene = prepare_scene(views, codec.device, guides)
        encoder = encoder_of(codec, scene)
    if guides is not None and scene.guides is not None:
        checks = check_guides(encoder.images[0], encoder.matching.depth, encoder.cameras.scene(0), scene.guides)
        for name, check in zip(guides.names, checks, strict=True):
            if not check.is_confirmed:
                on_omission(f"guide {name} is left out: {reason_of(check)}.", (name,))
        scene = replace(scene, guides=confirmed_guides(scene.guides, checks))
        is_matched = all(check.is_confirmed for check in checks)
        encoder = encoder.with_colours(scene.guides) if is_matched else encoder_of(codec, scene)
    for sentence in overlap_warnings(encoder.overlap, views.names):
        on_warning(sentence)
    return with_far_regions(encoder) if has_far_regions else encoder, scene


def encoder_of(codec: Codec, scene: Scene) -> SceneEncoder:
    """Return the encoder of one scene, without what the sender was trained without."""
    return without(codec.sender.config.ablation, SceneEncoder).of(codec, scene)


def write_scene(
    encoder: SceneEncoder,
    scene: Scene,
    lambda_q: int,
    num_stages: int,
    config: OptimisationConfig,
    on_progress: OnProgress = ignore_progress,
) -> bytes:
    """Return the bytes of the stream of one scene: its stages, then the detail layer if the model has one.

    Raises InputError for a lambda outside the range of the model, and for a sharpness that it does not have.
    """
    receiver = encoder.codec.receiver
    check_lambda(receiver.config, lambda_q)
    if config.sharpness != 0.0 and encoder.codec.sender.sharp_steps is None:
        raise InputError("this model has no network for `sharpness`; leave it out, or choose another model.")
    num_detail_steps = config.detail_steps_of(encoder.num_views, encoder.num_pixels, lambda_q)
    has_detail = receiver.detail is not None and num_detail_steps > 0
    of_latents = lambda_of_latents(scene.num_views, scene.num_guides, lambda_q) if has_detail else lambda_q
    if of_latents > lambda_q:
        config = replace(config, extra_step_above=())  # detail does what these steps would
    of_stages = sum(improvements_of(encoder, config, of_latents).times(num_stages))
    times = TIME_OF_MATCHING, of_stages, TIME_OF_DETAIL_STEP * num_detail_steps if has_detail else 0.0
    _, for_stages, for_detail = Progress(on_progress).split(*times)
    stages = write_stages(encoder, of_latents, num_stages, config, for_stages)
    stream = assemble(encoder.codec, scene, stages)
    if has_detail:
        stream = replace(stream, detail=find_detail(encoder, stages[-1], lambda_q, config, for_detail))
    return write_stream(stream)


def write_stages(
    encoder: SceneEncoder,
    lambda_q: int,
    num_stages: int,
    config: OptimisationConfig,
    progress: Progress = Progress(),  # noqa: B008 - frozen
) -> tuple[Stage[WrittenLatent], ...]:
    """Run the stages of one scene, with the improvements of the model's method, and entropy-code the latents.

    A model that was trained with one stage codes one. Raises InputError for a lambda outside the range of the model.
    """
    model = encoder.codec.receiver.config
    check_lambda(model, lambda_q)
    improve, num_stages = improvements_of(encoder, config, lambda_q), min(num_stages, model.num_stages)
    return encoder.run(torch.tensor([lambda_q]), num_stages, write_latents(encoder.codec), improve, progress)


def improvements_of(encoder: SceneEncoder, config: OptimisationConfig, lambda_q: int) -> Improvements:
    """Return the optimisation of latents, and fading, if the model's method has them. Without steps nothing fades."""
    if not encoder.codec.receiver.config.kind.has_steps:
        return NO_IMPROVEMENTS
    num_guides = 0 if encoder.guides is None else encoder.guides.count
    are_taught = is_taught(encoder.num_views, num_guides)
    num_steps = config.steps_of_stages(encoder.num_pixels, lambda_q, is_taught=are_taught)
    latent = optimiser(encoder, config, estimate_bits(encoder.codec), num_steps)
    of_scene = encoder.images[0], encoder.cameras.scene(0), encoder.background, encoder.ignored, encoder.guides
    is_faded = faded_views(encoder) if config.num_steps > 0 else None
    fade = None if is_faded is None else fader(*of_scene, is_faded)
    return Improvements(latent, fade, num_steps)


def faded_views(encoder: SceneEncoder) -> Bool[Tensor, " view"] | None:
    """Return which views may fade: all of many; of three or four those that none confirms, if any; None for none."""
    if encoder.num_views < 3 or encoder.num_pixels > MAX_PIXELS:
        return None
    if encoder.num_views >= LEAST_VIEWS:
        return torch.ones(encoder.num_views, dtype=torch.bool)
    is_unconfirmed = encoder.overlap.most_confirmed < LEAST_CONFIRMED
    return is_unconfirmed if bool(is_unconfirmed.any()) else None


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
