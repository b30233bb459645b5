"""Files that may hold cameras, of whatever program: by their names, by what they hold, by names of arrays in them."""

import os
import re
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path

from fecocodec.input_file import first_bytes
from fecocodec.photographs.image_headers import has_image_name

HEAD_BYTES = 8192
_LARGEST_TEXT = 1 << 20  # bytes
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z0-9]+|\d+")  # of `KeyFrameTrajectory`, `cam2world_all`
_CAMERAS = re.compile(
    r"(cam(era)?s?|poses?|[ei][xn]trinsics?|traj(s|ectory|ectories)?|transforms?|calib(ration|rated)?|focals?|c2w|w2c"
    r"|cam(era)?2world|world2cam(era)?|odometry|groundtruth|opk)\d*",
    re.IGNORECASE,
)
# What also reports and logs are called, so text is left out.
_RECONSTRUCTION = re.compile(r"(bundle|sfm|reconstructions?|colmap|sparse|shots|orientations?)\d*", re.IGNORECASE)
ARCHIVE_SUFFIXES = (".zip", ".7z", ".rar", ".tar", ".gz", ".tgz", ".bz2", ".xz", ".zst")
_TEXTS = {".txt", ".csv", ".log", ".dat", ".yaml", ".yml", ".ini", ".cfg", ".tum", ".opk"}
_OTHERS = {
    *(".json", ".jsonl", ".geojson", ".jgz", ".xml", ".npy", ".npz", ".pt", ".pth", ".pkl", ".mat", ".h5", ".hdf5"),
    *(".bin", ".out", ".abc", ".usd", ".usda", ".usdc", ".usdz", ".fbx", ".chan", *ARCHIVE_SUFFIXES),
}
_KEYS = re.compile(
    rb'"(\w*(extrinsics?|c2w|w2c|cam(era)?_?(2|to)_?world|world_?(2|to)_?cam(era)?)\w*|(cam(era)?_?)?poses?(ARFrame)?'
    rb'|transform_?matrix|rotation_?matrix|quaternion)"\s*:',
    re.IGNORECASE,
)
_SHAPE = re.compile(rb"'shape': \((\d+), ((?:3|4), 4|3, 5|7|12|15|16|17)\)")  # in the header of a NumPy array
_COLUMNS_OF_POSES = {7, 8, 12, 13, 16, 17, 19}
DEPTH = 5  # of a file: output/colmap/sparse/0/images.bin
_MOST_FOLDERS = 400
_MOST_ENTRIES = 20_000  # of a folder


def walk(folder: Path, depth: int = DEPTH) -> Iterator[Path]:
    """Yield files and folders up to `depth` levels below a folder, the nearest first, then by name.

    Hidden ones are left out, and so is a folder that was met before, by a link. Of huge trees, some are left out.
    """
    level, met = [folder], {folder.resolve()}
    for further in range(depth, 0, -1):
        below = list[Path]()
        for place in level:
            with suppress(OSError), os.scandir(place) as entries:
                for name, is_folder in sorted((one.name, one.is_dir()) for one in islice(entries, _MOST_ENTRIES)):
                    if name.startswith("."):
                        continue
                    yield place / name
                    if is_folder and further > 1 and len(met) < _MOST_FOLDERS and (place / name).resolve() not in met:
                        met.add((place / name).resolve())
                        below.append(place / name)
        level = below


def has_camera_name(path: Path) -> bool:
    """Return whether the name of a file or folder, or of an array in it, is one that cameras have."""
    if path.is_dir():
        below = (file for pattern in ("*", "*/*") for file in path.glob(pattern) if not has_image_name(file))
        return _is_called(path.name, is_text=False) and any(map(_may_hold_data, below))
    if not _may_hold_data(path):
        return False
    suffix = path.suffix.lower()
    names = [path.stem, *(_arrays_of(path) if suffix == ".npz" else ())]
    return path.stem == "K" or any(_is_called(name, is_text=suffix in _TEXTS) for name in names)


def has_poses(path: Path, count: int) -> bool:
    """Return whether a file of numbers has as many poses as there are photographs, or fewer, or JSON has a pose."""
    try:
        suffix, size = path.suffix.lower(), path.stat().st_size
        if suffix == ".npy":
            shape = _SHAPE.search(first_bytes(path, HEAD_BYTES))
            return shape is not None and int(shape[1]) == count
        if suffix in (".json", ".jsonl"):
            return _KEYS.search(first_bytes(path, HEAD_BYTES)) is not None
        if suffix not in (".txt", ".csv", ".log", ".dat") or size > _LARGEST_TEXT:
            return False
        return _is_table_of_poses(path.read_text("utf-8", "replace"), count)
    except OSError:
        return False


def words_of(name: str) -> list[str]:
    """Return the words of a name such as `KeyFrameTrajectory_2`; numbers count, other signs do not."""
    return _WORD.findall(name)


def _is_called(name: str, *, is_text: bool) -> bool:
    kinds = (_CAMERAS,) if is_text else (_CAMERAS, _RECONSTRUCTION)
    return not name.startswith("camera_path") and any(  # of nerfstudio, to render at
        kind.fullmatch(word) for word in words_of(name) for kind in kinds
    )


def _may_hold_data(path: Path) -> bool:
    return path.suffix.lower() in _TEXTS | _OTHERS and path.is_file()


def _is_table_of_poses(text: str, count: int) -> bool:
    """Return whether text is one matrix, or has a pose in each of at most `count` lines, after an optional title."""
    rows = [row for line in text.splitlines() if (row := line.replace(",", " ").split()) and not row[0].startswith("#")]
    rows = rows if rows and _numbers(rows[0]) else rows[1:]
    widths = {_numbers(row) for row in rows}
    if len(widths) != 1:
        return False
    (width,) = widths
    is_matrix = (len(rows) in (3, 4) and width == 4) or (len(rows) == 1 and width in (12, 16))
    return is_matrix or (2 <= len(rows) <= count and width in _COLUMNS_OF_POSES)


def _numbers(row: list[str]) -> int:
    """Return how many numbers are in a line; the name of an image counts as one; 0 if there is something else."""
    try:
        [float(word) for word in row[has_image_name(Path(row[0])) :]]
    except ValueError:
        return 0
    return len(row)


def _arrays_of(path: Path) -> list[str]:
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return []
