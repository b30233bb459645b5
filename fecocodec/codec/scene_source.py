"""The scene folder to encode: the given folder, or one with cameras estimated for its photographs or a video."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fecocodec.atomic import temporary_folder
from fecocodec.camera_files.find import has_cameras, read_cameras
from fecocodec.camera_files.unused_cameras import earlier_estimate_notes, unread_cameras_notes
from fecocodec.captures.reading_notes import picture_remarks
from fecocodec.captures.view_choice import indices_of
from fecocodec.captures.view_selection import Guides, Selection, Spread
from fecocodec.captures.view_spread import require_count, spare_for_checks
from fecocodec.codec.messages import of_input
from fecocodec.codec.options import DEFAULT_FRAMES, EncodingOptions
from fecocodec.errors import InputError, OptionError, error_context, one_sentence
from fecocodec.photographs.video_frames import is_video, write_sharp_frames


@dataclass(frozen=True)
class SceneSource:
    """path: a folder with photographs and cameras.

    Sentences: notes on how cameras were estimated, omissions of photographs, warnings why the estimate may be wrong.
    save_cameras: writes the estimated cameras, see `PosedFolder.save_cameras`; None if the cameras were given. Of a
    video, it takes the folder of the `frames`, too. has_camera: whether each photograph has an estimated one, by its
    name in the order of the folder; empty if the cameras were given.
    """

    path: Path
    notes: tuple[str, ...] = ()
    omissions: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    save_cameras: Callable[..., None] | None = None
    has_camera: Mapping[str, bool] = field(default_factory=dict)

    def named(self, chosen: Selection | Guides | None, option: str) -> Any:
        """Return chosen photographs by names where cameras were estimated: numbers count those without a camera, too.

        Raises InputError for a photograph that has no camera. option: that messages name.
        """
        if not self.has_camera or not isinstance(chosen, tuple):
            return chosen
        names = list(self.has_camera)
        called = []
        for view in map(str, chosen):
            is_number = view not in self.has_camera and view.isdecimal() and int(view) < len(names)
            called.append(names[int(view)] if is_number else view)
            if not self.has_camera.get(Path(called[-1]).name, True):
                raise InputError(f"{called[-1]} has no camera, see above; choose another photograph in `{option}`.")
        return tuple(called)


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
    from fecocodec.poses.unposed_photographs import find_photographs

    with ExitStack() as stack:
        photographs, of_video, warnings = path, tuple[str, ...](), tuple[str, ...]()
        if is_video(path):
            photographs = options.frames_folder or stack.enter_context(temporary_folder())
            count = options.num_frames or DEFAULT_FRAMES
            of_video, warnings = write_sharp_frames(path, photographs, count, is_most=options.num_frames is None)
        threads, is_masked = options.num_threads, options.masks != "unused"
        files = find_photographs(photographs)
        names = [file.name for file in files]
        _require_possible(files, options, path)
        cameras = posed_folder(photographs, threads, str(path), options.focal_px, has_masks=is_masked)
        try:
            posed = stack.enter_context(cameras)
        except InputError as error:
            raise InputError(
                of_input(path, one_sentence([str(error), *unread_cameras_notes(path, outcome="")]))
            ) from error
        of_photographs = [] if is_video(path) else [*picture_remarks(list(posed.photographs)), *_videos_note(path)]
        notes = (*earlier_estimate_notes(path), *of_video, *of_photographs, *posed.notes)
        warnings = (*unread_cameras_notes(path), *warnings, *posed.warnings)

        posed_names = {camera.name for camera in posed.reconstruction.cameras}
        has_camera = {name: name in posed_names for name in names}
        for frame in posed.photographs if is_video(path) else ():
            if frame.name not in posed_names:
                frame.unlink()

        def save_beside(file: Path, *, overwrite: bool = False, frames: Path | None = None) -> None:
            """Name the frames of a video as files in `frames`; None for the folder of the file."""
            named = tuple((frames or file.parent) / frame.name for frame in posed.photographs)
            replace(posed, photographs=named).save_cameras(file, overwrite=overwrite)

        save = save_beside if is_video(path) else posed.save_cameras
        yield SceneSource(posed.path, notes, posed.omissions, warnings, save, has_camera)


def _require_possible(files: list[Path], options: EncodingOptions, path: Path) -> None:
    """Raise InputError for a choice that no estimate of cameras makes possible: estimating them takes minutes."""
    for option, chosen in (("views", options.views), ("guides", options.guides)):
        if isinstance(chosen, tuple):
            indices_of(files, files, chosen, path, option)
    named = options.views if isinstance(options.views, tuple) else ()
    if isinstance(options.views, Spread):
        with error_context(path):
            require_count(options.views.count, len(files))
    spare_for_checks(len(files) - len(named), options.views, options.num_checks, path, is_named=bool(named))


def _videos_note(folder: Path) -> list[str]:
    """Return a sentence if videos lie beside photographs whose cameras are estimated."""
    videos = sorted(path.name for path in folder.iterdir() if is_video(path))
    return (
        [f"videos beside photographs are not used ({', '.join(videos)}); give one itself to use it."] if videos else []
    )


def require_no_cameras(path: Path, option: str) -> None:
    """Raise OptionError if the input has cameras, InputError if it has neither cameras nor photographs."""
    if not is_video(path) and has_cameras(path):
        read_cameras(path)  # reports a folder that has neither
        raise OptionError(f"`{option}` is for photographs without cameras; this folder has cameras.")
