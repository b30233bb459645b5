"""`encode_folder`: a folder or ZIP archive of photographs, or a video -> the bytes of a file, and what is to be said.

What cameras and headers of images tell is reported before torch is loaded, and before any pixel is read.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from fecocodec.camera_files.find import read_cameras
from fecocodec.camera_files.posed_photographs import PosedPhotographs, distinct_names
from fecocodec.captures.archives import is_archive, unpacked
from fecocodec.captures.view_selection import Auto
from fecocodec.codec.messages import Messages, OnMessage
from fecocodec.codec.options import EncodingOptions
from fecocodec.codec.read_by_role import read_by_role
from fecocodec.codec.roles import LEAST_FOR_CHOICE, Roles
from fecocodec.codec.scene_source import scene_source
from fecocodec.container import read_header
from fecocodec.errors import SizeError, error_context
from fecocodec.input_file import StrPath
from fecocodec.limits import MAX_VIEWS
from fecocodec.model_files import is_shipped, model_folder
from fecocodec.progress import OnProgress, Progress, ignore_progress
from fecocodec.sender.lambda_search import AtLeastNewPsnr, AtMostKib
from fecocodec.sender.view_quality import (
    DecodedQuality,
    LeftOutQuality,
    is_lowered_by_stage_2,
    left_out_warnings,
    new_view_warnings,
    quality_warnings,
    stage_2_note,
    worst_view_warnings,
)

if TYPE_CHECKING:
    from fecocodec.codec.encode_views import Photographs

TIMES = 0.2, 0.68, 0.12  # for progress: of the choice of views, encoding, and measuring


@dataclass(frozen=True)
class OtherViews:
    """Photographs that are not coded. quality: rendered at their own cameras; None if there are none or by choice."""

    names: tuple[str, ...] = ()
    quality: DecodedQuality | None = None


@dataclass(frozen=True)
class EncodingReport:
    """An encoded folder.

    data: bytes of the `.fcs` file. names: of the coded views. quality: of these, decoded from `data`, after each stage;
    empty if it was not measured. guides: what the sender learned from. checks: what it never saw; their quality is that
    of new views. left_out: quality of coded views without their own Gaussians, where there is one check or none; None
    if it was not measured, or no view shows what another one does. unused: names of the rest, by the reason for it.
    is_fitted: whether lambda was chosen by the checks. notes, warnings: one sentence each. seconds: time taken.
    save_cameras: writes the cameras that were estimated as `transforms.json`, see `PosedFolder.save_cameras`; None if
    cameras were given.
    """

    data: bytes
    names: tuple[str, ...]
    quality: tuple[DecodedQuality, ...]
    guides: OtherViews
    checks: OtherViews
    left_out: LeftOutQuality | None
    unused: Mapping[str, tuple[str, ...]]
    is_fitted: bool
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    seconds: float
    save_cameras: Callable[..., None] | None

    @property
    def num_unused(self) -> int:
        """Number of photographs that are not used."""
        return sum(map(len, self.unused.values()))


def encode_folder(
    path: StrPath,
    options: EncodingOptions = EncodingOptions(),  # noqa: B008 - frozen
    *,
    on_progress: OnProgress = ignore_progress,
    on_note: OnMessage = lambda _sentence: None,
    on_warning: OnMessage = lambda _sentence: None,
) -> EncodingReport:
    """Encode a folder of photographs, a ZIP archive of it, a camera file or a video, as the command `encode` does.

    Cameras are estimated if there are none. on_progress: as for `encode`. on_note, on_warning: called with each
    sentence as soon as it is known; the result has all of them. Nothing is written.
    Raises InputError for input or options that cannot be used, StrictError for a warning if `is_strict`, ModelError if
    weights cannot be loaded.
    """
    start, path = perf_counter(), Path(path)
    messages = Messages(path, options.is_strict, on_note, on_warning)
    if options.device != "cpu":  # the check loads torch
        options.require_device()
    on_progress("reading views", 0.0)
    with unpacked(path) as folder, scene_source(folder, options) as source:
        messages.folder = folder
        messages.note(*source.notes)
        for sentence in source.omissions:
            messages.omit(sentence)
        messages.warn(*source.warnings)
        with error_context(path):
            named = {option: source.named(getattr(options, option), option) for option in ("views", "guides")}
        options = replace(options, **named)
        scene = read_cameras(source.path)
        messages.note(*scene.remarks)
        is_chosen = not isinstance(options.views, tuple) and len(scene.photographs) >= LEAST_FOR_CHOICE
        if is_chosen and source.save_cameras is None:
            from fecocodec.codec.fitting_cameras import with_fitting_cameras  # it loads torch

            scene, better = with_fitting_cameras(scene, options.masks)
            if better is not None:
                messages.note(better.remark)
        times = TIMES if is_chosen else (0.0, *TIMES[1:])
        of_choice, of_encoding, of_measuring = Progress(on_progress).split(*times)
        roles, photographs, data = _encoded(scene, options, messages, of_choice, of_encoding)

    from fecocodec.codec.encode_views import encode_views

    views, guides, checks = photographs.views, photographs.guides, photographs.checks
    if guides is not None and messages.omitted:
        kept = [index for index, name in enumerate(guides.names) if name not in messages.omitted]
        guides = guides.select(kept) if kept else None
    quality: tuple[DecodedQuality, ...] = ()
    of_guides = of_checks = left_out = None
    if options.is_measured or options.is_strict:
        from fecocodec.sender.codec import load_codec
        from fecocodec.sender.decoded_quality import left_out_quality, measure_with_others

        of_measuring("measuring quality")
        device, model = options.device, options.model
        receiver = load_codec(model_folder(model), device).receiver
        has_steps = receiver.config.kind.has_steps
        effort = options.effort if has_steps else "best"  # the paper's method has one: no other effort can be advised
        measure = partial(measure_with_others, views=views, others=(guides, checks), device=device, model=model)
        quality, (of_guides, of_checks) = measure(data)
        is_lowered = is_lowered_by_stage_2(quality) and is_lowered_by_stage_2(measure(data, is_merged=False)[0])
        if is_lowered and options.target is None:
            alone = encode_views(views, guides, checks, replace(options, num_stages=1), Messages(path), of_measuring)
            if (of_one := measure(alone))[0][-1].psnr > quality[-1].psnr:
                messages.note(stage_2_note(quality))
                data, (quality, (of_guides, of_checks)) = alone, of_one
        if checks is None or len(checks.names) == 1:
            left_out = left_out_quality(receiver, data, views)
        are_estimated = source.save_cameras is not None
        worst = worst_view_warnings(quality[-1], views.names, are_estimated=are_estimated)
        if checks is not None and of_checks is not None:
            is_any_left = guides is not None or len(roles.unused) > 0
            count = len(views.names)
            messages.warn(
                *new_view_warnings(of_checks, checks.names, count, is_any_left, effort, are_estimated=are_estimated),
                *worst,
            )
        else:
            poor = quality_warnings(quality[-1], views.names, effort, are_estimated=are_estimated)
            if not poor and left_out is not None and is_shipped(read_header(data).header.model_id):
                poor = left_out_warnings(left_out, views.names, are_estimated=are_estimated)
            messages.warn(*(poor or worst))
    name_of = distinct_names([photograph.path for photograph in scene.photographs])
    return EncodingReport(
        data,
        views.names,
        quality,
        OtherViews(() if guides is None else guides.names, of_guides),
        OtherViews(() if checks is None else checks.names, of_checks),
        left_out,
        {reason: tuple(name_of[index] for index in of) for reason, of in roles.unused.items()},
        isinstance(options.target, AtLeastNewPsnr),
        tuple(messages.notes),
        tuple(messages.warnings),
        round(perf_counter() - start, 3),
        None if is_archive(path) else source.save_cameras,  # its photographs are no longer unpacked
    )


def _encoded(
    scene: PosedPhotographs,
    options: EncodingOptions,
    messages: Messages,
    of_choice: OnProgress,
    of_encoding: OnProgress,
) -> tuple[Roles, "Photographs", bytes]:
    """Choose, read and encode photographs; fewer of them where as many as the scene needs exceed a target in KiB."""
    most = MAX_VIEWS
    while True:
        roles, photographs = read_by_role(scene, options, messages, of_choice, most)
        messages.note(*photographs.views.remarks)

        from fecocodec.codec.encode_views import encode_views  # it loads torch

        parts, count = (photographs.views, photographs.guides, photographs.checks), len(photographs.views.names)
        try:
            return roles, photographs, encode_views(*parts, options, messages, of_encoding)
        except SizeError as error:
            is_chosen = options.views is None or isinstance(options.views, Auto)
            if not is_chosen or not 2 < count <= most or not isinstance(options.target, AtMostKib):
                raise  # more than `most`: so few photographs that all are coded
            most = max(2, min(count - 1, int(count * options.target.kib / error.kib)))
            messages.note(f"{count} coded photographs take {error.kib:.1f} KiB or more; at most {most} are coded.")
