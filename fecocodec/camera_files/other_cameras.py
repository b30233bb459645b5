"""Camera files that lie in a scene folder beside the one that is read, so that none is passed over in silence."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from fecocodec.camera_files.camera_names import (
    ARCHIVE_SUFFIXES,
    HEAD_BYTES,
    has_camera_name,
    has_poses,
    walk,
    words_of,
)
from fecocodec.errors import some_of
from fecocodec.input_file import first_bytes
from fecocodec.photographs.image_headers import has_image_name

_MOST_NAMED = 4
_MOST_WORDS = 2  # of the name of a folder of cameras
_DEPTH_OF_NAMES = 2  # below the scene folder; files of known programs are found farther down


@dataclass(frozen=True)
class _Kind:
    """A camera file of another program. pattern: end of its path. content: expression for its beginning."""

    program: str
    pattern: str
    content: bytes = b""


_KINDS = (
    _Kind("sdfstudio", "meta_data.json"),
    _Kind("Polycam", "keyframes/cameras/*.json"),
    _Kind("Polycam", "keyframes/corrected_cameras/*.json"),
    _Kind("Metashape", "*.xml", b"<chunk"),
    _Kind("Metashape", "*.psx"),
    _Kind("Metashape", "*.psz"),
    _Kind("BlocksExchange", "*.xml", b"<BlocksExchange"),
    _Kind("RealityCapture", "*.csv", b"#name,"),
    _Kind("RealityCapture", "*.csv", b"#cameras"),
    _Kind("RealityCapture", "*.xmp", b"xcr:"),
    _Kind("RealityCapture", "*.rcproj"),
    _Kind("OpenSfM", "reconstruction.json"),
    _Kind("Bundler", "*.out", b"# Bundle file"),
    _Kind("VisualSFM", "*.nvm", b"NVM_V"),
    _Kind("OpenMVG", "*.json", b'"sfm_data_version"'),
    _Kind("OpenMVG", "sfm_data.bin"),
    _Kind("Meshroom", "*.sfm"),
    _Kind("MicMac", "Ori-*/*.xml"),
    _Kind("Pix4D", "*_calibrated_camera_parameters.txt"),
    _Kind("OpenDroneMap", "shots.geojson"),
    _Kind("kapture", "sensors/trajectories.txt"),
    _Kind("ARKit, Record3D", "metadata.json", b'"poses"'),
    _Kind("ARKit, 3D Scanner App", "*.json", b'"cameraPoseARFrame"'),
    _Kind("ARKit, Stray Scanner", "odometry.csv"),
    _Kind("ARKitScenes", "*.traj"),
    _Kind("Nerfies", "camera/*.json", b'"orientation"'),
    _Kind("EuRoC", "state_groundtruth*/data.csv"),
    _Kind("CO3D", "frame_annotations.jgz"),
    _Kind("Nuke", "*.chan"),
    _Kind("VGGT", "predictions.npz"),
    _Kind("MVSNet", "cams/*_cam.txt"),
    _Kind("DUSt3R", "pred_traj.txt"),
    _Kind("DUSt3R", "scene.pkl"),
    _Kind("DUSt3R", "scene.pt"),
    _Kind("TUM RGB-D", "groundtruth.txt"),
    _Kind("Redwood, Open3D", "*.log", rb"\A\s*(\d+\s+){3}([-+.\deE]+\s+){16}"),
)
_KINDS_BY_SUFFIX = {
    suffix: [kind for kind in _KINDS if kind.pattern.endswith(suffix)]
    for suffix in {Path(kind.pattern).suffix for kind in _KINDS}
}


def unread_cameras(folder: Path, read: set[Path], count: int = 0) -> str:
    """Return which camera files in a folder are of kinds that are not read: `cameras.xml (Metashape)`; empty if none.

    read: camera files of kinds that are read. count: of photographs without cameras. Besides files of known programs,
    those with names such as `poses.npy` count, archives of NumPy with such arrays, and, if `count` is given, files with
    as many poses.
    """
    files = [path for path in walk(folder) if not has_image_name(path)]
    others = [path for path in files if len(path.relative_to(folder).parts) <= _DEPTH_OF_NAMES]
    return _listed(folder, _found(folder, files, others, read, count))


def unread_cameras_around(folder: Path, read: set[Path], names: set[str], *, is_near: bool) -> str:
    """Return such files in a folder above photographs, which may hold other scenes, too. is_near: if directly above.

    names: of the photographs. Folders count by names such as `corrected_cameras` if there are neither folders nor
    images in them, but files called as cameras or numbered as the photographs are.
    """
    keys = {_key(Path(name)) for name in names}
    files = [path for kind in _KINDS for path in sorted(folder.glob(kind.pattern))]
    near = walk(folder, 1) if is_near else ()
    others = [path for path in near if has_camera_name(path) and _is_of_cameras(path, keys)]
    return _listed(folder, _found(folder, files, others, read))


def program_of(path: Path) -> str:
    """Return the program whose camera file this is, empty if it is of no known kind."""
    kinds = _KINDS_BY_SUFFIX.get(path.suffix, ())  # of thousands of files, most are of none
    found = [kind for kind in kinds if path.match(kind.pattern)]
    head = first_bytes(path, HEAD_BYTES) if any(kind.content for kind in found) else b""
    return next((kind.program for kind in found if re.search(kind.content, head)), "")


def _listed(folder: Path, found: Iterable[tuple[str, Path]]) -> str:
    named: dict[str, list[Path]] = {}
    for program, path in found:
        named.setdefault(program, []).append(path)
    shown = [
        some_of([path.relative_to(folder) for path in paths], 1) + (f" ({program})" if program else "")
        for program, paths in named.items()
    ]
    return ", ".join(shown[:_MOST_NAMED]) + (" and others" if len(shown) > _MOST_NAMED else "")


def _found(
    folder: Path, files: list[Path], others: list[Path], read: set[Path], count: int = 0
) -> Iterator[tuple[str, Path]]:
    """Yield the `files` of known programs, with these, then files and folders of `others` that look like cameras.

    Those are left out that lie with `read` ones in one folder of the scene folder, and others beside known ones.
    """
    told = {_top(folder, path) for path in read if path != folder}
    known = [(program, path) for path in files if _top(folder, path) not in told and (program := program_of(path))]
    yield from dict.fromkeys(known)
    told |= {_top(folder, path) for _, path in known}
    for path in others:
        if {path, _top(folder, path)} & told:
            continue
        if has_camera_name(path) or (count and path.is_file() and has_poses(path, count)):
            told |= {path} if path.is_dir() else set()
            yield "", path


def _is_of_cameras(path: Path, keys: set[str]) -> bool:
    """Return whether nothing else is likely in what has a name of cameras. keys: of the photographs."""
    if not path.is_dir():
        return path.suffix.lower() not in ARCHIVE_SUFFIXES
    files = list(path.iterdir())
    if len(words_of(path.name)) > _MOST_WORDS or any(below.is_dir() or has_image_name(below) for below in files):
        return False
    return any(_key(below) in keys or has_camera_name(below) for below in files)


def _key(path: Path) -> str:
    """Return the last number in the name of a file, else its name, by which cameras and photographs correspond."""
    numbers = re.findall(r"\d+", path.stem)
    return str(int(numbers[-1])) if numbers else path.stem


def _top(folder: Path, path: Path) -> Path:
    """Return the file or folder in `folder` that is or holds `path`."""
    return folder / path.relative_to(folder).parts[0]
