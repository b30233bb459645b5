"""Camera files that lie in a scene folder beside the one that is read, so that none is passed over in silence."""

import re
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fecocodec.errors import some_of
from fecocodec.photographs.image_headers import has_image_name

_HEAD_BYTES = 8192
_MOST_NAMED = 4


@dataclass(frozen=True)
class _Kind:
    """A camera file of another program. pattern: glob below the scene folder. content: expression for its beginning."""

    program: str
    pattern: str
    content: bytes = b""


_KINDS = (
    _Kind("sdfstudio", "meta_data.json"),
    _Kind("Polycam", "keyframes/cameras/*.json"),
    _Kind("Polycam", "keyframes/corrected_cameras/*.json"),
    _Kind("Metashape", "*.xml", b"<chunk"),
    _Kind("Metashape", "*.psx"),
    _Kind("BlocksExchange", "*.xml", b"<BlocksExchange"),
    _Kind("RealityCapture", "*.csv", b"#name,"),
    _Kind("RealityCapture", "*.csv", b"#cameras"),
    _Kind("RealityCapture", "*.xmp", b"xcr:"),
    _Kind("RealityCapture", "images/*.xmp", b"xcr:"),
    _Kind("OpenSfM", "reconstruction.json"),
    _Kind("OpenSfM", "opensfm/reconstruction.json"),
    _Kind("Bundler", "*.out", b"# Bundle file"),
    _Kind("Bundler", "bundle/*.out", b"# Bundle file"),
    _Kind("VisualSFM", "*.nvm", b"NVM_V"),
    _Kind("OpenMVG", "*.json", b'"sfm_data_version"'),
    _Kind("Meshroom", "*.sfm"),
    _Kind("ARKit, Record3D", "metadata.json", b'"poses"'),
    _Kind("ARKit, 3D Scanner App", "*.json", b'"cameraPoseARFrame"'),
    _Kind("ARKit, Stray Scanner", "odometry.csv"),
    _Kind("ARKitScenes", "*.traj"),
    _Kind("VGGT", "predictions.npz"),
    _Kind("MVSNet", "cams/*_cam.txt"),
    _Kind("DUSt3R", "pred_traj.txt"),
    _Kind("TUM RGB-D", "groundtruth.txt"),
    _Kind("Redwood, Open3D", "*.log", rb"\A\s*(\d+\s+){3}([-+.\deE]+\s+){16}"),
)
_NAME = re.compile(r"cam(era)?s?|poses?|extrinsics?|intrinsics?|traj(ectory)?|transforms?|calibration|focals?", re.I)
_SUFFIXES = {".json", ".xml", ".csv", ".txt", ".npy", ".npz", ".pt", ".pth", ".pkl", ".log", ".out", ".yaml", ".yml"}


def unread_cameras(folder: Path, read: set[Path]) -> str:
    """Return which camera files in a folder are of kinds that are not read: `cameras.xml (Metashape)`; empty if none.

    read: camera files of kinds that are read. Besides files of known programs, those with names such as `poses.npy`
    count, and archives of NumPy with such arrays.
    """
    named: dict[str, list[Path]] = {}
    for program, path in _found(folder, set(read)):
        named.setdefault(program, []).append(path)
    shown = [
        some_of([path.relative_to(folder) for path in paths], 1) + (f" ({program})" if program else "")
        for program, paths in named.items()
    ]
    return ", ".join(shown[:_MOST_NAMED]) + (" and others" if len(shown) > _MOST_NAMED else "")


def program_of(path: Path) -> str:
    """Return the program whose camera file this is, empty if it is of no known kind."""
    return next((kind.program for kind in _KINDS if path.match(kind.pattern) and _has(path, kind.content)), "")


def _found(folder: Path, seen: set[Path]) -> Iterator[tuple[str, Path]]:
    """Yield camera files that are not in `seen`, with their program; each file once."""
    for kind in _KINDS:
        for path in sorted(folder.glob(kind.pattern)):
            if path not in seen and _has(path, kind.content):
                seen |= {path, folder / path.relative_to(folder).parts[0]}
                yield kind.program, path
    for path in sorted(folder.iterdir()):
        if path not in seen and not path.name.startswith(".") and _may_hold_cameras(path):
            yield "", path


def _may_hold_cameras(path: Path) -> bool:
    """Return whether the name of a file or folder, or of an array in it, is one that cameras have."""
    if path.is_dir():
        return _NAME.fullmatch(path.name) is not None and not all(map(has_image_name, path.iterdir()))
    if path.suffix.lower() not in _SUFFIXES or not path.is_file():
        return False
    names = [path.stem, *(_arrays_of(path) if path.suffix.lower() == ".npz" else ())]
    return any(_NAME.fullmatch(word) for name in names for word in re.split(r"[\W_]+", name))


def _arrays_of(path: Path) -> list[str]:
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return []


def _has(path: Path, content: bytes) -> bool:
    if not content:
        return True
    try:
        with path.open("rb") as file:
            return re.search(content, file.read(_HEAD_BYTES)) is not None
    except OSError:
        return False
