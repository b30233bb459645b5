"""The scene folder to encode: the given folder, or one with cameras estimated for its photographs or a video."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from fecocodec.camera_files.find import cameras_above, has_cameras, read_cameras, unread_cameras_notes
from fecocodec.captures.chosen_photographs import ChosenPhotographs
from fecocodec.captures.scene_folder import read_others, read_pixels
from fecocodec.codec.messages import Messages, OnMessage, of_input
from fecocodec.codec.options import DEFAULT_FRAMES, EncodingOptions
from fecocodec.errors import InputError, OptionError
from fecocodec.geometry.views import Views
from fecocodec.photographs.video_frames import is_video, write_sharp_frames


@dataclass(frozen=True)
class SceneSource:
    """path: a folder with photographs and cameras.

    notes: how the cameras were estimated. warnings: why the estimate may be wrong. One sentence each. save_cameras:
    writes the estimated cameras, see `PosedFolder.save_cameras`; None if the cameras were given. Of a video, it takes
    the folder of the `frames`, too.
    """

    path: Path
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    save_cameras: Callable[..., None] | None = None


@contextmanager
def scene_source(path: Path, options: EncodingOptions) -> Iterator[SceneSource]:
    """Yield a scene folder that exists until the block ends.

    Raises InputError as `posed_folder` and `write_sharp_frames` do, OptionError for options of another kind of input.
    """
    for option, value in (("frames", options.num_frames), ("save_frames", options.frames_folder)):
        if value is not None and not is_video(path):
            raise OptionError(f"`{option}` is for a video file.")
    if not is_video(path) and has_cameras(path):
        if options.focal_px is not None:
            require_no_cameras(path, "focal_px")
        yield SceneSource(path)
        return

    from fecocodec.poses.posed_folder import posed_folder  # loads scipy.optimize, which takes 0.3 s

    with ExitStack() as stack:
        photographs, of_video = path, tuple[str, ...]()
        if is_video(path):
            temporary = TemporaryDirectory(prefix="fecosplat-")
            photographs = options.frames_folder or Path(stack.enter_context(temporary))
            count = options.num_frames or DEFAULT_FRAMES
            of_video = write_sharp_frames(path, photographs, count, is_most=options.num_frames is None)
        threads, is_masked = options.num_threads, options.masks != "unused"
        cameras = posed_folder(photographs, threads, str(path), options.focal_px, has_masks=is_masked)
        try:
            posed = stack.enter_context(cameras)
        except InputError as error:
            raise InputError(of_input(path, str(error))) from error
        notes = (*unread_cameras_notes(path), *of_video, *posed.notes)
        if not is_video(path) and (file_above := cameras_above(path)):
            above = path.absolute().parent
            notes += (f"{file_above} has cameras; to use them instead, give the folder {above}.",)

        posed_names = {camera.name for camera in posed.reconstruction.cameras}
        for frame in posed.photographs if is_video(path) else ():
            if frame.name not in posed_names:
                frame.unlink()

        def save_beside(file: Path, *, overwrite: bool = False, frames: Path | None = None) -> None:
            """Name the frames of a video as files in `frames`; None for the folder of the file."""
            named = tuple((frames or file.parent) / frame.name for frame in posed.photographs)
            replace(posed, photographs=named).save_cameras(file, overwrite=overwrite)

        save = save_beside if is_video(path) else posed.save_cameras
        yield SceneSource(posed.path, notes, posed.warnings, save)


def require_no_cameras(path: Path, option: str) -> None:
    """Raise OptionError if the input has cameras, InputError if it has neither cameras nor photographs."""
    if not is_video(path) and has_cameras(path):
        read_cameras(path)  # reports a folder that has neither
        raise OptionError(f"`{option}` is for photographs without cameras; this folder has cameras.")


@dataclass(frozen=True)
class Photographs:
    """views: to be coded. guides, checks: of the same size; None for none."""

    views: Views
    guides: Views | None
    checks: Views | None


def read_photographs(
    context: ChosenPhotographs,
    guides: ChosenPhotographs | None,
    checks: ChosenPhotographs | None,
    options: EncodingOptions,
    messages: Messages,
) -> Photographs:
    """Read the photographs. Guides that cannot be used are left out, unless they are named; so are checks.

    Raises InputError for a coded photograph, or a guide that is named, that cannot be used.
    """
    colour, masks = options.background, options.masks
    taught = kept_back = None
    if guides is not None:
        taught = read_others(
            guides, background=colour, masks=masks, on_left_out=None if options.guides else messages.omit
        )
    if checks is not None:
        kept_back = read_others(checks, background=colour, masks=masks, on_left_out=messages.omit)
    views = read_pixels(context, near=options.near, far=options.far, background=colour, masks=masks, guides=taught)
    if taught is not None:
        taught = _alike(taught, views, messages.refuse if options.guides else messages.omit)
    if kept_back is not None:
        kept_back = _alike(kept_back, views, messages.omit)
    return Photographs(views, taught, kept_back)


def _alike(others: Views, views: Views, on_left_out: OnMessage) -> Views | None:
    """Return the photographs that are cut out or opaque as the coded ones are, with the same bounds of depth."""
    is_cut_out, are_cut_out = any(_are_cut_out(views)), _are_cut_out(others)
    kept = [index for index, other in enumerate(are_cut_out) if other == is_cut_out]
    if unlike := [name for index, name in enumerate(others.names) if index not in kept]:
        found, usual = ("opaque", "cut out") if is_cut_out else ("transparent in part", "opaque")
        on_left_out(
            f"left out {', '.join(unlike)}, {found}, while the coded photographs are {usual}; cut out the object in "
            "all, or give all without transparency."
        )
    bounds = replace(others.cameras, near=views.cameras.near, far=views.cameras.far)
    others = replace(others, cameras=bounds, alpha=others.alpha if is_cut_out else None)
    return others.select(kept) if kept else None


def _are_cut_out(views: Views) -> list[bool]:
    """Return which views are transparent in part."""
    if views.alpha is None:
        return [False] * len(views.images)
    return [bool(share < 1.0) for share in views.alpha.mean(dim=(1, 2))]
