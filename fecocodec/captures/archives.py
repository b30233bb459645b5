"""ZIP archives of photographs, with or without a camera file: unpacked to a temporary folder."""

import stat
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from shutil import copyfileobj

from fecocodec.atomic import is_disk_full, temporary_folder
from fecocodec.camera_files.formats import camera_files
from fecocodec.camera_files.image_matching import parts_of
from fecocodec.errors import FecoError, InputError, of_archive
from fecocodec.input_file import MAX_FILE_BYTES, StrPath
from fecocodec.photographs.image_headers import IMAGE_SUFFIXES, PHOTOGRAPH_FOLDERS, UNREAD_SUFFIXES
from fecocodec.photographs.video_frames import VIDEO_SUFFIXES
from fecocodec.poses.unposed_photographs import find_photographs

MAX_MEMBERS = 20_000
MAX_TOTAL_BYTES = 32 << 30
_CAMERA_SUFFIXES = (
    ".json", ".txt", ".bin", ".npy", ".npz", ".csv", ".xml", ".xmp", ".out", ".nvm", ".sfm", ".traj", ".log", ".psx",
    ".yaml", ".yml", ".jsonl", ".geojson", ".jgz", ".rcproj", ".chan",
)  # fmt: skip
_IMAGE_KINDS = {*IMAGE_SUFFIXES, *UNREAD_SUFFIXES}
_WANTED = {*_IMAGE_KINDS, *_CAMERA_SUFFIXES}
_INNER_SUFFIXES = (*VIDEO_SUFFIXES, ".zip", ".7z", ".rar", ".tar", ".gz", ".tgz")
_REMEDY = "unpack it and give the folder"
_IS_UTF8 = 1 << 11  # flag of a member's name


def is_archive(path: Path) -> bool:
    """Return whether a path is that of a ZIP file."""
    return path.suffix.lower() == ".zip" and path.is_file()


@contextmanager
def unpacked(path: StrPath) -> Iterator[Path]:
    """Yield the scene folder of a ZIP archive, which exists until the block ends; any other path as it is.

    Photographs and camera files are unpacked, hidden files and those of `__MACOSX` are not. A folder around all of them
    is left out. In errors that the block raises, files are named as parts of the archive.
    Raises InputError for an archive that is damaged, encrypted, too large, or leads out of its folder, OutputError if
    the disk of the temporary folder is full.
    """
    path = Path(path)
    if not is_archive(path):
        yield path
        return
    with temporary_folder() as temporary:
        try:
            _unpack(path, temporary)
        except (zipfile.BadZipFile, EOFError, NotImplementedError, ValueError, OSError) as error:
            if is_disk_full(error):
                raise
            reason = getattr(error, "strerror", None) or str(error)
            is_damaged = isinstance(error, zipfile.BadZipFile | EOFError)
            remedy = "it is damaged or no ZIP archive: copy it again" if is_damaged else _REMEDY
            raise InputError(f"{path}: the ZIP archive cannot be unpacked ({reason}); {remedy}.") from error
        root = _innermost(temporary)
        is_scene = camera_files(root) or any(file.suffix.lower() in _IMAGE_KINDS for file in root.rglob("*"))
        if not is_scene and (inner := _inner(path)):
            raise InputError(
                f"{path}: the ZIP archive holds no photographs, but {inner}; unpack it and give that file."
            )
        try:
            yield root
        except FecoError as error:
            named = type(error)(of_archive(str(error), root, path))
            vars(named).update(vars(error))
            raise named from error


def _unpack(path: Path, target: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        members = [member for member in archive.infolist() if _is_wanted(member)]
        total = sum(member.file_size for member in members)
        largest = max((member.file_size for member in members), default=0)
        if len(members) > MAX_MEMBERS or total > MAX_TOTAL_BYTES or largest > MAX_FILE_BYTES:
            raise InputError(f"{path}: the ZIP archive holds too many or too large files; {_REMEDY}.")
        for member in members:
            if member.flag_bits & 1:
                raise InputError(f"{path}: the ZIP archive is encrypted; {_REMEDY}.")
            file = target / _inside(path, _name(member))
            file.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(member) as source, file.open("wb") as copy:
                copyfileobj(source, copy)


def _name(member: zipfile.ZipInfo) -> str:
    """Return the name of a member, which macOS writes in UTF-8 without saying so."""
    if member.flag_bits & _IS_UTF8:
        return member.filename
    try:
        return member.filename.encode("cp437").decode()
    except UnicodeError:
        return member.filename


def _inner(path: Path) -> str | None:
    """Return the first video or archive in an archive; None if there is none."""
    with zipfile.ZipFile(path) as archive:
        names = (_name(member) for member in archive.infolist() if not _is_hidden(member))
        return next((name for name in names if name.lower().endswith(_INNER_SUFFIXES)), None)


def _is_hidden(member: zipfile.ZipInfo) -> bool:
    return any(part.startswith((".", "__MACOSX")) and part != ".." for part in parts_of(member.filename))


def _is_wanted(member: zipfile.ZipInfo) -> bool:
    parts = parts_of(member.filename)
    is_link = stat.S_ISLNK(member.external_attr >> 16)
    suffix = PurePosixPath(parts[-1]).suffix.lower() if parts else ""
    return not (member.is_dir() or _is_hidden(member) or is_link) and suffix in _WANTED


def _inside(path: Path, name: str) -> Path:
    parts = parts_of(name)
    if name.startswith(("/", "\\")) or ".." in parts or ":" in parts[0]:
        raise InputError(f"{path}: its member {name} leads out of the archive; {_REMEDY}.")
    return Path(*parts)


def _innermost(folder: Path) -> Path:
    """Return the folder below those that hold one folder and at most notes, unless that is one of a scene.

    The notes are moved there: cameras of a kind that is not read may be among them.
    """
    entries = list(folder.iterdir())
    folders = [path for path in entries if path.is_dir()]
    if len(folders) != 1 or folders[0].name in (*PHOTOGRAPH_FOLDERS, "sparse"):
        return folder
    has_more = len(entries) > 1 and (camera_files(folder) or find_photographs(folder))
    if has_more:
        return folder
    for path in entries:
        if path != folders[0] and not (target := folders[0] / path.name).exists():
            path.rename(target)
    return _innermost(folders[0])
