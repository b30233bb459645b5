"""`encode_folder`: a folder of photographs, or a video -> the bytes of a file, and what there is to say about it.

What cameras and headers of images tell is reported before torch is loaded, and before any pixel is read.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from fecocodec.captures.chosen_photographs import ChosenPhotographs, choose_photographs
from fecocodec.captures.reading_notes import scaling_remark
from fecocodec.codec.messages import Messages, OnMessage
from fecocodec.codec.options import EncodingOptions
from fecocodec.codec.scene_source import scene_source
from fecocodec.input_file import StrPath
from fecocodec.progress import OnProgress, ignore_progress
from fecocodec.sender.view_quality import DecodedQuality, quality_warnings, stage_warnings


@dataclass(frozen=True)
class EncodingReport:
    """An encoded folder.

    data: bytes of the `.fcs` file. names: of the coded views. left_out: names of views that harm the others. quality:
    of the coded views, decoded from `data`, after each stage; empty if it was not measured. notes, warnings: one
    sentence each. seconds: time taken. save_cameras: writes the cameras that were estimated as `transforms.json`, see
    `PosedFolder.save_cameras`; None if cameras were given.
    """

    data: bytes
    names: tuple[str, ...]
    left_out: tuple[str, ...]
    quality: tuple[DecodedQuality, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    seconds: float
    save_cameras: Callable[..., None] | None


def encode_folder(
    path: StrPath,
    options: EncodingOptions = EncodingOptions(),  # noqa: B008 - frozen
    *,
    on_progress: OnProgress = ignore_progress,
    on_note: OnMessage = lambda _sentence: None,
    on_warning: OnMessage = lambda _sentence: None,
) -> EncodingReport:
    """Encode a folder of photographs, a camera file or a video, as the command `fecosplat encode` does.

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
    with scene_source(path, options) as source:
        messages.note(*source.notes)
        messages.warn(*source.warnings)
        chosen = _chosen(source.path, options, messages)

        from fecocodec.captures.scene_folder import read_pixels
        from fecocodec.codec.encode_views import encode_views, without_harmful
        from fecocodec.sender.optimisation_config import config_of_effort

        config_of_effort(options.effort, options.sharpness)  # raises for one that there is not
        given = {name: getattr(options, name) for name in ("near", "far", "background", "masks")}
        views = read_pixels(chosen, **given)
        messages.note(*views.remarks)
    views, left_out = without_harmful(views, options, messages, on_progress)
    data, quality = encode_views(views, options, messages, on_progress)
    if quality:
        messages.warn(*stage_warnings(quality), *quality_warnings(quality[-1], views.names))
    return EncodingReport(
        data,
        views.names,
        left_out,
        quality,
        tuple(messages.notes),
        tuple(messages.warnings),
        round(perf_counter() - start, 3),
        source.save_cameras,
    )


def _chosen(folder: Path, options: EncodingOptions, messages: Messages) -> ChosenPhotographs:
    """Choose the photographs to encode, from cameras and headers. Raises InputError."""
    chosen = choose_photographs(folder, views=options.views, size=options.size)
    messages.note(*chosen.remarks)
    messages.warn(*chosen.notes)
    pinholes = [pinhole for _, pinhole in chosen.lenses]
    if options.size is None and (remark := scaling_remark(pinholes, chosen.image_size)):
        messages.note(remark)
    return chosen
