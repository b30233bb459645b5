"""Choose the photographs of a scene folder to encode: their lenses and their common size, before pixels are read."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fecocodec.camera_files.find import read_cameras
from fecocodec.camera_files.pose_validation import require_float32_range, rigid_pose
from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs, require_images, stored_lens
from fecocodec.camera_files.view_choice import choose_views
from fecocodec.captures.reading_notes import framing_notes, lens_notes, orientation_notes, unposed_notes
from fecocodec.captures.view_spread import auto_views
from fecocodec.input_file import StrPath
from fecocodec.limits import MAX_VIEWS
from fecocodec.photographs.framing import common_size, framed_intrinsics, require_size
from fecocodec.photographs.lens import Lens


@dataclass(frozen=True)
class ChosenPhotographs:
    """Chosen photographs, before their pixels are read.

    lenses: of the stored images, and the pinholes to which they are undistorted. image_size: common (height, width).
    extrinsics, intrinsics: of the cameras, for that size. notes: see `Views`.
    """

    scene: PosedPhotographs
    photographs: list[PosedPhotograph]
    lenses: list[tuple[Lens, Lens]]
    image_size: tuple[int, int]
    extrinsics: Float[np.ndarray, "view 4 4"]
    intrinsics: Float[np.ndarray, "view 3 3"]
    notes: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(photograph.path.name for photograph in self.photographs)

    def select(self, indices: list[int]) -> "ChosenPhotographs":
        """Return these photographs, in this order."""
        return replace(
            self,
            photographs=[self.photographs[index] for index in indices],
            lenses=[self.lenses[index] for index in indices],
            extrinsics=self.extrinsics[indices],
            intrinsics=self.intrinsics[indices],
        )


def choose_photographs(
    path: StrPath, *, views: tuple[int | str, ...] | None = None, size: tuple[int, int] | None = None
) -> ChosenPhotographs:
    """Read poses, lenses and sizes from the camera file and the headers of the images; needs no torch.

    Arguments are those of `read_views`. Raises InputError if the folder, a camera or the header of an image cannot be
    used.
    """
    path = Path(path)
    scene = read_cameras(path)
    photographs, notes = _chosen_photographs(scene, views, path)
    return framed(scene, photographs, size, notes)


def framed(
    scene: PosedPhotographs, photographs: list[PosedPhotograph], size: tuple[int, int] | None, notes: list[str]
) -> ChosenPhotographs:
    """Return photographs of a scene with their lenses, cropped to a common size. notes: on their choice.

    Raises InputError if a camera or the header of an image cannot be used.
    """
    if size:
        require_size(size)
    require_images(photographs)
    poses = np.stack([rigid_pose(photograph.camera_to_world, photograph.place) for photograph in photographs])
    require_float32_range(poses, str(scene.cameras_path))
    lenses = [stored_lens(photograph) for photograph in photographs]
    pinholes = [pinhole for _, pinhole in lenses]
    common = size or common_size(pinholes, [str(photograph.path) for photograph in photographs])
    intrinsics = np.stack([framed_intrinsics(pinhole, common) for pinhole in pinholes])
    names = [photograph.path.name for photograph in photographs]
    sizes = [photograph.declared_size for photograph in photographs]
    on_reading = [*lens_notes(pinholes, names, sizes), *framing_notes(pinholes, names, common)]
    on_reading += orientation_notes([photograph.path for photograph in photographs])
    return ChosenPhotographs(scene, photographs, lenses, common, poses, intrinsics, (*notes, *on_reading))


def _chosen_photographs(
    scene: PosedPhotographs, views: tuple[int | str, ...] | None, path: Path
) -> tuple[list[PosedPhotograph], list[str]]:
    """Return the photographs to read, and notes on those that are not, unless the caller has chosen."""
    if views is not None:
        return choose_views(scene.photographs, views, path), []
    notes = unposed_notes(scene)
    if len(scene.photographs) <= MAX_VIEWS:
        return scene.photographs, notes
    photographs = [scene.photographs[index] for index in auto_views(scene)]
    names = ", ".join(photograph.path.name for photograph in photographs)
    note = f"{len(photographs)} of {len(scene.photographs)} photographs are used ({names}); choose others by `views`."
    return photographs, [*notes, note]
