"""Photographs with cameras, before pixels are read; the common result of all camera formats."""

import math
import os
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fecocodec.camera_files.image_matching import MatchedImages, short_name
from fecocodec.errors import InputError
from fecocodec.input_file import require_regular_file
from fecocodec.photographs.image_headers import read_image_size
from fecocodec.photographs.lens import Lens, require_representable, undistorted

MAX_SCALE_ERROR = 1e-2
MAX_ROTATION_ERROR = 1e-3


@dataclass(frozen=True)
class PosedPhotograph:
    """One photograph with its camera.

    path: the image file, which need not exist. place: location of the camera in its file, for messages.
    camera_to_world: OpenCV axes, as stored. lens_for: (width, height) of the stored pixels -> lens.
    sparse_depths: depths, in scene units, of the reconstructed points that this photograph observes, if the format has
    them. declared_size: (width, height) in pixels that the camera file states, None if it states none. name: of the
    image in the camera file. problem: why this camera cannot be used, as an error message that begins with `place`;
    empty if it can. is_told: whether the user was told of it. mask: file of its mask that the camera file names, see
    `read_mask`.
    """

    path: Path
    place: str
    camera_to_world: Float[np.ndarray, "4 4"]
    lens_for: Callable[[int, int], Lens]
    sparse_depths: Float[np.ndarray, " point"] = field(default_factory=lambda: np.zeros(0))
    declared_size: tuple[int, int] | None = None
    name: str = ""
    problem: str = ""
    is_told: bool = False
    mask: Path | None = None

    @property
    def cause(self) -> str:
        """Return `problem` without its place."""
        return self.problem.removeprefix(self.place).lstrip(":, ")


@dataclass(frozen=True)
class PosedPhotographs:
    """All photographs of a scene folder, in the order of its camera file.

    near, far: depth bounds of that file. remarks: one sentence for each choice that reading made, such as the folder of
    the images. posed_elsewhere: images of which another camera file beside it, such as that of a split, has cameras.
    """

    cameras_path: Path
    photographs: list[PosedPhotograph]
    near: float | None = None
    far: float | None = None
    remarks: tuple[str, ...] = ()
    posed_elsewhere: frozenset[Path] = frozenset()

    @property
    def cameras_name(self) -> str:
        """Return the name of the camera file for messages."""
        return short_name(self.cameras_path)


CameraReader = Callable[[Path, str], PosedPhotograph]  # (image, place)


def photographs_of(images: MatchedImages, cameras: Iterable[tuple[str, CameraReader]]) -> list[PosedPhotograph]:
    """Read the cameras of images, each given as (place, reader). A reader that raises InputError gives a problem.

    A pose that is not rigid is a problem too, and so are a lens that no image of the stated size has, and a second
    camera of one image.
    """
    photographs: list[PosedPhotograph] = []
    found = dict[str, Path]()
    for name, path, (place, read) in zip(images.names, images.paths, cameras, strict=True):
        photograph = replace(_checked(path, place, read), name=name)
        file = _file_of(path) or str(path)
        if file in found and not photograph.problem and os.path.isfile(path):
            problem = (
                f"{place}: another frame has this image, too, and its camera is used; name the image of each with its "
                "folder, or remove one."
            )
            photograph = replace(photograph, path=found[file], problem=problem)
        found.setdefault(file, path)
        photographs.append(photograph)
    return photographs


def _file_of(path: Path) -> str | None:
    """Return the path without links; None for a name that no file can have."""
    try:
        return os.path.realpath(path)
    except ValueError:
        return None


def _checked(path: Path, place: str, read: CameraReader) -> PosedPhotograph:
    try:
        if _file_of(path) is None:
            raise InputError(f"{place}: no file can have the name of its image; correct the name.")
        photograph = read(path, place)
        rigid_pose(photograph.camera_to_world, place)
        if photograph.declared_size:
            require_representable(photograph.lens_for(*photograph.declared_size), place)
        return photograph
    except InputError as error:
        return PosedPhotograph(path, place, np.full((4, 4), np.nan), _no_lens, problem=str(error))


def _no_lens(width: int, height: int) -> Lens:
    raise AssertionError("the camera has a problem; check `problem` first")


def require_usable(photographs: list[PosedPhotograph], *, are_images_needed: bool = True) -> None:
    """Raise InputError for the first camera that has a problem, or for missing images."""
    for photograph in photographs:
        if photograph.problem:
            raise InputError(photograph.problem)
    missing = [photograph for photograph in photographs if not has_image(photograph)] if are_images_needed else []
    if not missing:
        return
    first = f"{missing[0].place}: there is no image {missing[0].path}"
    if len(missing) == 1:
        raise InputError(f"{first}; put it there or leave this view out by `views`.")
    raise InputError(
        f"{first}, and of {len(photographs)} images {len(missing)} are missing in all; put them there or choose others "
        "by `views`."
    )


def has_image(photograph: PosedPhotograph) -> bool:
    """Return whether the image exists. Raises InputError if it cannot be looked at or is no regular file."""
    try:
        if photograph.path.exists() and not photograph.path.is_dir():
            require_regular_file(photograph.path)
        return photograph.path.is_file()
    except OSError as error:
        raise InputError(
            f"{photograph.place}: its image {photograph.path} cannot be looked at ({error.strerror}); check its name "
            "and the permissions of its folder."
        ) from error


def stored_lens(photograph: PosedPhotograph) -> tuple[Lens, Lens]:
    """Return the lens of a photograph and the pinhole to which it is undistorted. Reads only the image's header.

    Raises InputError if there is no image, or image and lens do not match.
    """
    require_usable([photograph])
    height, width = read_image_size(photograph.path)
    lens = photograph.lens_for(width, height)
    require_representable(lens, photograph.place)
    return lens, undistorted(lens, photograph.place)


def known_pinhole(photograph: PosedPhotograph, size: tuple[int, int] | None = None) -> Lens:
    """Return the pinhole to which a photograph is undistorted; the photograph need not exist.

    Without a photograph, the lens is for the size that the camera file states, else for `size` = (height, width).
    Raises InputError if no size is known, or the camera is not valid.
    """
    if photograph.path.is_file():
        return stored_lens(photograph)[1]
    require_usable([photograph], are_images_needed=False)
    declared = photograph.declared_size or (size and (size[1], size[0]))
    if declared is None:
        raise InputError(
            f"{photograph.place}: there is no image {photograph.path}, and the camera file states no image size; "
            "put the image there or give `size`."
        )
    lens = photograph.lens_for(*declared)
    require_representable(lens, photograph.place)
    return undistorted(lens, photograph.place)


def distinct_names(paths: list[Path]) -> tuple[str, ...]:
    """Return the names of files, each with as many of its folders as tell it from the others (`cam1/0001.jpg`)."""
    names = {path: path.name for path in paths}
    for depth in range(2, max((len(path.parts) for path in paths), default=0) + 1):
        common = {name for name, count in Counter(names.values()).items() if count > 1}
        names |= {path: "/".join(path.parts[-depth:]) for path, name in names.items() if name in common}
    return tuple(names[path] for path in paths)


def require_numbers(values: object, shape: tuple[int, ...], place: str) -> Float[np.ndarray, "*shape"]:
    """Convert values to float64. Raises InputError, which begins with `place`, for another shape, NaN or infinity."""
    if values is None:  # which NumPy converts to NaN
        raise InputError(f"{place}: {shape_text(shape)} expected; export the cameras again.")
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{place}: {shape_text(shape)} expected; export the cameras again.") from error
    if array.shape != shape:
        raise InputError(
            f"{place}: {shape_text(shape)} expected, {shape_text(array.shape)} found; export the cameras again."
        )
    if not np.isfinite(array).all():
        raise InputError(f"{place}: a camera value is NaN or infinite; correct it or take this view out of the file.")
    return array


def shape_text(shape: tuple[int, ...]) -> str:
    if not shape:
        return "a number"
    return f"{math.prod(shape)} numbers" if len(shape) == 1 else f"{'x'.join(map(str, shape))} numbers"


def rigid_pose(matrix: Float[np.ndarray, "4 4"], place: str) -> Float[np.ndarray, "4 4"]:
    """Return the rigid pose nearest to a 4x4 camera-to-world matrix with rounding errors, in float64.

    A scale within 1% and errors of the axes up to 1e-3 are corrected (nearest rotation by SVD, Schönemann 1966).
    Raises InputError, which begins with `place`, if the matrix is singular, mirrored, scaled or sheared.
    """
    axes = matrix[:3, :3]
    if not np.allclose(matrix[3], (0, 0, 0, 1), atol=MAX_ROTATION_ERROR):
        raise InputError(f"{place}: the last row of the pose is not 0 0 0 1; export camera-to-world matrices.")
    if not np.abs(axes).max() < 1e6:
        raise InputError(f"{place}: the axes of the pose are far from unit length; export camera-to-world matrices.")
    determinant = float(np.linalg.det(axes))
    if abs(determinant) < 1e-12:
        raise InputError(f"{place}: the pose is singular (its axes span no volume); export the cameras again.")
    if determinant < 0:
        raise InputError(
            f"{place}: the pose is mirrored (determinant {determinant:.3g}); export right-handed camera axes."
        )
    scale = np.cbrt(determinant)
    left, _, right = np.linalg.svd(axes)
    rotation = left @ right
    error = float(np.abs(axes / scale - rotation).max())
    if abs(scale - 1) > MAX_SCALE_ERROR or error > MAX_ROTATION_ERROR:
        raise InputError(
            f"{place}: the pose is no rotation (scale {scale:.4g}, axes off by {error:.2g}); "
            "export camera-to-world matrices without scale and shear."
        )
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, matrix[:3, 3]
    return pose


def require_float32_range(poses: Float[np.ndarray, "view 4 4"], place: str) -> None:
    """Raise InputError if cameras are so far from the origin that float32 cannot represent their distances."""
    centres = poses[:, :3, 3]
    extent = float(np.ptp(centres, axis=0).max())
    farthest = float(np.abs(centres).max())
    if farthest > 1e30 or (extent > 0 and farthest * np.finfo(np.float32).eps > 1e-3 * extent):
        raise InputError(
            f"{place}: the cameras lie {extent:.3g} apart but {farthest:.3g} from the origin, too far for float32; "
            "move the origin of the scene near the cameras."
        )
