"""The scene folder to encode: the given folder, or one with cameras estimated for its photographs or a video."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from fecocodec.atomic import require_other_file, require_writable

from .paths import require_ending

DEFAULT_FRAMES = 8


@dataclass(frozen=True)
class SceneSource:
    """path: a folder with photographs and cameras.

    notes: how the cameras were estimated. warnings: why the estimate may be wrong. One sentence each.
    """

    path: Path
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def require_cameras_file(cameras_file: Path | None, views: Path, *, overwrite: bool) -> None:
    """Raise OutputError if the file for estimated cameras cannot be written."""
    if cameras_file is not None:
        require_writable(cameras_file, overwrite=overwrite)
        require_ending(cameras_file, (".json",))
        require_other_file(cameras_file, views)


@contextmanager
def scene_source(
    views: Path, num_frames: int | None, cameras_file: Path | None, focal_px: float | None, *, overwrite: bool
) -> Iterator[SceneSource]:
    """Yield a scene folder that exists until the block ends; then write estimated cameras to `cameras_file`.

    Nothing is written if the block raises. num_frames: number of frames to take from a video. focal_px: as for
    `posed_folder`. Raises InputError as `posed_folder` and `video_frames` do.
    """
    from fecocodec.camera_files.find import cameras_above, has_cameras, read_cameras, unread_cameras_notes
    from fecocodec.photographs.video_frames import is_video, write_sharp_frames

    if num_frames is not None and not is_video(views):
        raise click.UsageError("--frames is for a video file.")
    if not is_video(views) and has_cameras(views):
        for option, value in (("--save-cameras", cameras_file), ("--focal-px", focal_px)):
            if value is not None:
                read_cameras(views)  # reports a folder that has neither cameras nor photographs
                raise click.UsageError(f"{option} is for photographs without cameras; this folder has cameras.")
        yield SceneSource(views)
        return

    from fecocodec.poses.posed_folder import posed_folder  # loads scipy.optimize, which takes 0.3 s

    with ExitStack() as stack:
        photographs = views
        if is_video(views):
            photographs = Path(stack.enter_context(TemporaryDirectory(prefix="fecosplat-")))
            write_sharp_frames(views, photographs, num_frames or DEFAULT_FRAMES)
        posed = stack.enter_context(posed_folder(photographs, name=str(views), focal_px=focal_px))
        notes = [*(f"note: {note}" for note in unread_cameras_notes(views)), *posed.notes]
        if not is_video(views) and (cameras := cameras_above(views)):
            above = views.absolute().parent
            notes.append(f"note: {cameras} has cameras; to use them instead, give the folder {above}.")
        if cameras_file is not None and is_video(views):  # its frames are temporary files
            beside = tuple(cameras_file.parent / frame.name for frame in posed.photographs)
            posed = replace(posed, photographs=beside)
            notes.append(
                f"{cameras_file}: the frames of the video are not saved; to encode from this file, extract them "
                f"beside it ({beside[0].name} is the frame with this number, from 0)."
            )
        yield SceneSource(posed.path, tuple(notes), posed.warnings)
        if cameras_file is not None:
            posed.save_cameras(cameras_file, overwrite=overwrite)
