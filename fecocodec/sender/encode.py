"""`encode`: posed photographs -> stream."""

from functools import lru_cache
from pathlib import Path

import torch

from fecocodec.checkpoint import DEFAULT_MODEL, RECEIVER_FILE, SENDER_FILE, SHIPPED
from fecocodec.container import EXCESS_UNIT, Header, Keep, Stream, quantise_lambda, write_stream
from fecocodec.container.header import MAX_STAGES, MAX_VIEWS
from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.layers.placement import place
from fecocodec.receiver.decode import OnProgress
from fecocodec.receiver.load import load_receiver
from fecocodec.sender.load import load_sender
from fecocodec.sender.refinement import refine_stage, refined_first_latents, steps_of_first, suitable_steps
from fecocodec.sender.steps import (
    CodedStage,
    MatchedViews,
    PreparedScene,
    Profile,
    analyse,
    code_stage,
    feedback_features,
    first_stage_lambda_q,
    match_views,
    prepare,
    stage_rendering,
)

__all__ = ["Profile", "assemble", "check_views", "code_stages", "encode", "encode_with", "header_of", "load_profile"]

MIN_SIDE, MAX_SIDE = 64, 1024


def encode(
    views: Views,
    *,
    lmbda: float = 1e-3,
    num_stages: int = 2,
    refinement_steps: int | None = None,
    device: str = "cpu",
    model: str = DEFAULT_MODEL,
    weights: str | Path = SHIPPED,
    on_progress: OnProgress = lambda _task, _fraction: None,
) -> bytes:
    """Bytes of a `.fcs` stream that `decode` turns into the Gaussians of these views.

    lmbda: price of a bit a pixel against squared error, in [1e-5, 1e-2]; larger means smaller files. num_stages: 1
    leaves the feedback stage out. refinement_steps: of the last stage's latents (see `refinement`; a first stage that
    is not the last gets half as many and one), None for what suits the size; two take about as long as all the rest.
    model, weights: `<weights>/<model>/` holds the weights of both ends.

    Raises InputError for views or options that cannot be coded, ModelError where weights are missing.
    """
    lambda_q = quantise_lambda(lmbda)
    check_views(views, num_stages)
    profile = load_profile(Path(weights) / model, device)
    return encode_with(profile, views, lambda_q, num_stages, on_progress, refinement_steps)


@lru_cache(maxsize=2)
@torch.inference_mode(False)
def load_profile(folder: Path, device: str) -> Profile:
    """Both ends' networks from a model's folder; raises ModelError where its files are missing, damaged or foreign."""
    receiver, model_id = load_receiver(folder / RECEIVER_FILE)
    sender = load_sender(folder / SENDER_FILE, receiver.config, model_id)
    for network in (sender, receiver):
        place(network, device)
    return Profile(sender, receiver, model_id)


@torch.inference_mode(False)  # a caller's: what is made in it can have no gradients, which refinement needs
@torch.no_grad()
def encode_with(
    profile: Profile,
    views: Views,
    lambda_q: int,
    num_stages: int,
    on_progress: OnProgress = lambda _task, _fraction: None,
    refinement_steps: int | None = None,
) -> bytes:
    """Encode with networks that are loaded; the sender works from the cameras that the receiver will see.

    Raises InputError for cameras that a stream cannot hold.
    """
    scene = prepare(profile, views)
    on_progress("matching views", 0.1)
    matched = match_views(profile, scene)
    stages = code_stages(profile, scene, matched, lambda_q, num_stages, on_progress, refinement_steps=refinement_steps)
    return assemble(profile, scene, stages)


def code_stages(
    profile: Profile,
    scene: PreparedScene,
    matched: MatchedViews,
    lambda_q: int,
    num_stages: int,
    on_progress: OnProgress = lambda _task, _fraction: None,
    stage_2_views: tuple[int, ...] | None = None,
    refinement_steps: int | None = None,
) -> tuple[CodedStage, ...]:
    """Stage 1 from what matching found, stage 2 from what stage 1's Gaussians make of the views.

    stage_2_views: the views that stage 2 codes, ascending from 0; None: all. refinement_steps: of all views' latents of
    the last stage, before some views are chosen; None: what suits the size.
    """
    num_steps = suitable_steps(scene, lambda_q) if refinement_steps is None else refinement_steps
    on_progress("coding stage 1", 0.3)
    is_last = num_stages == 1
    first_lambda_q = lambda_q if is_last else first_stage_lambda_q(lambda_q)
    steps = num_steps if is_last else steps_of_first(num_steps)
    latents = refined_first_latents(profile, scene, matched, first_lambda_q, steps)
    first = code_stage(profile, scene, latents, first_lambda_q, tuple(range(scene.num_views)), None)
    if is_last:
        return (first,)
    on_progress("rendering feedback", 0.5)
    rendering = stage_rendering(profile, scene, first.after)
    feedback = feedback_features(profile, scene, matched.depth, rendering, lambda_q)
    latents = analyse(profile, feedback, first.state, lambda_q, 2)
    on_progress("refining stage 2", 0.55)
    latents = refine_stage(profile, scene, latents, first, lambda_q, num_steps)
    on_progress("coding stage 2", 0.9)
    views = first.views if stage_2_views is None else stage_2_views
    return first, code_stage(profile, scene, latents.of_views(views), lambda_q, views, first)


def assemble(
    profile: Profile,
    scene: PreparedScene,
    stages: tuple[CodedStage, ...],
    keep: Keep | None = None,
) -> bytes:
    """The stream of these stages. keep: which Gaussians a receiver emits, None for all that can be seen."""
    header = header_of(profile, scene, stages)
    return write_stream(Stream(header, scene.packed, tuple(stage.payload for stage in stages), keep=keep))


def header_of(profile: Profile, scene: PreparedScene, stages: tuple[CodedStage, ...]) -> Header:
    """The header of a stream of these stages."""
    digests = tuple(stage.latents.digest() for stage in stages)
    views = stages[1].views if len(stages) == 2 else ()
    first, last = stages[0].lambda_q, stages[-1].lambda_q
    excess = (first - last) // EXCESS_UNIT
    return Header(profile.model_id, scene.num_views, *scene.image_size, last, digests, views, excess)


def check_views(views: Views, num_stages: int) -> None:
    """Raise InputError for views or a number of stages that cannot be coded."""
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
