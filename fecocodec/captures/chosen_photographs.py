"""Choose the photographs of a scene folder to encode: their lenses and their common size, before pixels are read."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fecocodec.camera_files.find import read_cameras
from fecocodec.camera_files.posed_photographs import (
    PosedPhotograph,
    PosedPhotographs,
    distinct_names,
    require_float32_range,
    require_usable,
    rigid_pose,
    stored_lens,
)
from fecocodec.captures.reading_notes import (
    framing_notes,
    lens_notes,
    orientation_notes,
    picture_remarks,
    unposed_notes,
    without_copies,
)
from fecocodec.captures.view_choice import select_views
from fecocodec.captures.view_selection import Auto, Selection
from fecocodec.input_file import StrPath
from fecocodec.limits import MAX_VIEWS, require_size
from fecocodec.photographs.framing import common_size, framed_intrinsics
from fecocodec.photographs.lens import Lens


@dataclass(frozen=True)
class ChosenPhotographs:
    """Chosen photographs, before their pixels are read.

    lenses: of the stored images, and the pinholes to which they are undistorted. image_size: common (height, width).
    extrinsics, intrinsics: of the cameras, for that size. names: of the files, with as many folders as tell them apart.
    notes: see `Views`. remarks: one sentence for each choice that the camera file left open, which is no reason to
    doubt the result.
    """

    scene: PosedPhotographs
    photographs: list[PosedPhotograph]
    lenses: list[tuple[Lens, Lens]]
    image_size: tuple[int, int]
    extrinsics: Float[np.ndarray, "view 4 4"]
    intrinsics: Float[np.ndarray, "view 3 3"]
    names: tuple[str, ...]
    notes: tuple[str, ...]
    remarks: tuple[str, ...]

    def select(self, indices: list[int]) -> "ChosenPhotographs":
        """Return these photographs, in this order."""
        return replace(
            self,
            photographs=[self.photographs[index] for index in indices],
            lenses=[self.lenses[index] for index in indices],
            extrinsics=self.extrinsics[indices],
            intrinsics=self.intrinsics[indices],
            names=tuple(self.names[index] for index in indices),
        )


def choose_photographs(
    path: StrPath, *, views: Selection | None = None, size: tuple[int, int] | None = None
) -> ChosenPhotographs:
    """Read poses, lenses and sizes from the camera file and the headers of the images; needs no torch.

    Arguments are those of `read_views`. Raises InputError if the folder, a camera or the header of an image cannot be
    used.
    """
    path = Path(path)
    scene = read_cameras(path)
    photographs, notes = select_views(scene, views, path)
    if isinstance(views, tuple):  # chosen by name: no notes on the others
        return framed(scene, photographs, size, notes)
    notes += unposed_notes(scene) if views is None else []
    if views is None and len(photographs) > MAX_VIEWS:
        total = len(photographs)
        photographs, _ = select_views(scene, Auto(), path)
        names = ", ".join(_names(scene, photographs))
        notes.append(f"{len(photographs)} of {total} photographs are used ({names}); choose others by `views`.")
    photographs, copies = without_copies(photographs)
    return framed(scene, photographs, size, notes + copies)


def framed(
    scene: PosedPhotographs, photographs: list[PosedPhotograph], size: tuple[int, int] | None, notes: list[str]
) -> ChosenPhotographs:
    """Return photographs of a scene with their lenses, cropped to a common size. notes: on their choice.

    Raises InputError if a camera or the header of an image cannot be used.
    """
    if size:
        require_size(size)
    require_usable(photographs)
    names = _names(scene, photographs)
    poses = np.stack([rigid_pose(photograph.camera_to_world, photograph.place) for photograph in photographs])
    require_float32_range(poses, str(scene.cameras_path))
    lenses = [stored_lens(photograph) for photograph in photographs]
    stored, pinholes = ([pair[part] for pair in lenses] for part in (0, 1))
    common = size or common_size(pinholes, [str(photograph.path) for photograph in photographs], stored)
    intrinsics = np.stack([framed_intrinsics(pinhole, common) for pinhole in pinholes])
    sizes = [photograph.declared_size for photograph in photographs]
    notes = [*notes, *lens_notes(stored, names, sizes), *framing_notes(lenses, names, common)]
    paths = [photograph.path for photograph in photographs]
    notes += orientation_notes(paths)
    remarks = (*scene.remarks, *picture_remarks(paths))
    return ChosenPhotographs(scene, photographs, lenses, common, poses, intrinsics, tuple(names), tuple(notes), remarks)


def _names(scene: PosedPhotographs, photographs: list[PosedPhotograph]) -> list[str]:
    """Return names that tell the photographs apart from all others of the scene."""
    paths = [photograph.path for photograph in scene.photographs]
    name_of = dict(zip(paths, distinct_names(paths), strict=True))
    return [name_of[photograph.path] for photograph in photographs]
