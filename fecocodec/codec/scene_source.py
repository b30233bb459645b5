"""The scene folder to encode: the given folder, or one with cameras estimated for its photographs or a video."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from fecocodec.camera_files.find import cameras_above, has_cameras, read_cameras, unread_cameras_notes
from fecocodec.codec.options import DEFAULT_FRAMES, EncodingOptions
from fecocodec.errors import OptionError
from fecocodec.photographs.video_frames import is_video, write_sharp_frames


@dataclass(frozen=True)
class SceneSource:
    """path: a folder with photographs and cameras.

    notes: how the cameras were estimated. warnings: why the estimate may be wrong. One sentence each. save_cameras:
    writes the estimated cameras, see `PosedFolder.save_cameras`; None if the cameras were given.
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
    if options.num_frames is not None and not is_video(path):
        raise OptionError("`frames` is for a video file.")
    if not is_video(path) and has_cameras(path):
        if options.focal_px is not None:
            require_no_cameras(path, "focal_px")
        yield SceneSource(path)
        return

    from fecocodec.poses.posed_folder import posed_folder  # loads scipy.optimize, which takes 0.3 s

    with ExitStack() as stack:
        photographs = path
        if is_video(path):
            photographs = Path(stack.enter_context(TemporaryDirectory(prefix="fecosplat-")))
            write_sharp_frames(path, photographs, options.num_frames or DEFAULT_FRAMES)
        posed = stack.enter_context(posed_folder(photographs, options.num_threads, str(path), options.focal_px))
        notes = (*unread_cameras_notes(path), *posed.notes)
        if not is_video(path) and (cameras := cameras_above(path)):
            above = path.absolute().parent
            notes += (f"{cameras} has cameras; to use them instead, give the folder {above}.",)

        def save_beside(file: Path, *, overwrite: bool = False) -> None:
            """Name the frames of a video, which are temporary files, as files beside that of the cameras."""
            frames = tuple(file.parent / frame.name for frame in posed.photographs)
            replace(posed, photographs=frames).save_cameras(file, overwrite=overwrite)

        save = save_beside if is_video(path) else posed.save_cameras
        yield SceneSource(posed.path, notes, posed.warnings, save)


def require_no_cameras(path: Path, option: str) -> None:
    """Raise OptionError if the input has cameras, InputError if it has neither cameras nor photographs."""
    if not is_video(path) and has_cameras(path):
        read_cameras(path)  # reports a folder that has neither
        raise OptionError(f"`{option}` is for photographs without cameras; this folder has cameras.")
