"""Estimate the cameras of a folder of photographs without poses, and write them as a scene folder."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from fecocodec.atomic import require_space, temporary_folder, write_file
from fecocodec.errors import InputError, one_sentence, some_of
from fecocodec.geometry.depth_bounds import bounds_of_depths
from fecocodec.photographs.image_headers import conversion_advice, is_misnamed, read_image_size
from fecocodec.photographs.lens import Lens
from fecocodec.poses.estimated_cameras import EstimatedCamera, ImageGroup, Reconstruction
from fecocodec.poses.pose_estimation import LEAST_POINTS, reconstruct
from fecocodec.poses.pose_warnings import reliability_warnings
from fecocodec.poses.unposed_photographs import (
    MAX_PHOTOGRAPHS,
    absent_photographs,
    find_photographs,
    unread_photographs,
    unused_images,
    upright_copies,
    upright_masks,
)
from fecocodec.poses.usable_estimate import require_usable

_BYTES_OF_FEATURES = 3 << 20  # of a photograph: 8192 features and their matches in the database
_MANY_MATCHES = 30  # of a pair; such pairs are counted in a note
# Widens the bounds of depth on both sides: surfaces without texture, or in only one photograph, have no points.
_DEPTH_MARGIN = 1.3
_OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
# Why photographs have no camera, after "left out": of their number of points, and "it" or "them".
_UNMATCHED = ": no matches with another photograph; take {1} again with more overlap"
_SCARCE = ", with {0} points whose position the others determine; add photographs that show the same parts (a camera "
_SCARCE += f"needs {LEAST_POINTS} such points)"
_MISFIT = ": no camera fits the {0} points whose position the others determine; something moved, or parts look alike"


@dataclass(frozen=True)
class PosedFolder:
    """A temporary scene folder with estimated cameras.

    reconstruction: with lenses in pixels of the photographs. Sentences for the user: notes on what was done, omissions
    of photographs, warnings why the cameras may be wrong.
    """

    path: Path
    photographs: tuple[Path, ...]
    reconstruction: Reconstruction
    notes: tuple[str, ...]
    omissions: tuple[str, ...]
    warnings: tuple[str, ...]

    def save_cameras(self, path: Path, *, overwrite: bool = False) -> None:
        """Write `transforms.json`, with relative paths of the photographs. Raises OutputError if writing fails."""
        photographs = {photograph.name: photograph for photograph in self.photographs}
        cameras = self.reconstruction.cameras
        files = [_relative_path(photographs[camera.name], path.parent) for camera in cameras]
        write_file(path, json.dumps(_transforms(cameras, files), indent=2) + "\n", overwrite=overwrite)


@contextmanager
def posed_folder(
    folder: Path, num_threads: int = -1, name: str = "", focal_px: float | None = None, *, has_masks: bool = True
) -> Iterator[PosedFolder]:
    """Estimate cameras and yield a scene folder that exists until the block ends. Photographs in it are upright.

    Photographs that cannot be registered are left out, with a warning. num_threads: -1 for all cores. name: of the
    input in messages, by default the folder. focal_px: known focal length in pixels of the photographs, None to
    estimate it. has_masks: leave out features in what masks mark; the scene folder then has upright masks, too.
    Raises InputError if fewer than two photographs can be registered, their cameras are not usable, or pycolmap is
    missing, OutputError if the disk of the temporary folder is full.
    """
    photographs, notes = _chosen(folder, name or str(folder))
    unread, count = _unread(folder), len(photographs)
    with temporary_folder() as root:
        groups, left_out = upright_copies(photographs, root, focal_px, num_threads)
        photographs = [path for path in photographs if (root / path.name).exists()]
        if len(photographs) < 2:
            raise InputError(f"{name or folder}: cameras are estimated from two photographs or more. {left_out[0]}")
        masks = upright_masks(photographs, root) if has_masks else None
        workspace = root / ".colmap"  # hidden, so that it is not named as that of other cameras
        workspace.mkdir()
        require_space(root, _BYTES_OF_FEATURES * len(photographs))
        reconstruction = reconstruct(root, groups, workspace, num_threads, masks)
        require_usable(name or str(folder), reconstruction, is_focal_given=focal_px is not None)
        for path in set(root.iterdir()) - {
            workspace,
            masks,
            *(root / camera.name for camera in reconstruction.cameras),
        }:
            path.unlink()  # a photograph without a camera, of which `_left_out` tells
        text = json.dumps(_transforms(reconstruction.cameras, [camera.name for camera in reconstruction.cameras]))
        (root / "transforms.json").write_text(text, encoding="utf-8")
        path_of = {path.name: path for path in photographs}
        cameras = tuple(_of_photograph(camera, path_of[camera.name]) for camera in reconstruction.cameras)
        lens = cameras[0].lens
        notes += _notes(count, reconstruction, groups, lens)
        omissions = (*left_out, *_left_out(photographs, reconstruction))
        warnings = (*unread, *reliability_warnings(reconstruction, groups, lens.fx))
        reconstruction = replace(reconstruction, cameras=cameras)
        yield PosedFolder(root, tuple(photographs), reconstruction, tuple(notes), omissions, warnings)


def _chosen(folder: Path, name: str) -> tuple[list[Path], list[str]]:
    """Return at most MAX_PHOTOGRAPHS photographs, evenly spread over the folder, with notes on those not used."""
    photographs = find_photographs(folder)
    if len(photographs) < 2:
        found = "one photograph" if photographs else "no photographs"
        need = "cameras are estimated from two or more; add photographs or a camera file"
        raise InputError(one_sentence([f"{name}: {found} without cameras, but {need}", *_unread(folder)]))
    unused = [path.relative_to(folder) for path in unused_images(folder)]
    notes = []
    if unused:
        notes.append(f"images in another folder, or maps by their names, are not used ({some_of(unused, 1)}).")
    if len(photographs) <= MAX_PHOTOGRAPHS:
        return photographs, notes
    kept = [photographs[index] for index in np.linspace(0, len(photographs) - 1, MAX_PHOTOGRAPHS).round().astype(int)]
    spread = f"{len(kept)} of {len(photographs)} photographs, evenly spread, are used to estimate cameras."
    return kept, [*notes, spread]


def _unread(folder: Path) -> list[str]:
    """Return warnings about photographs of kinds that cannot be read, and about those that are not here."""
    unread = unread_photographs(folder)
    of_kinds = f"of a kind that cannot be read; {conversion_advice(unread)}."
    warnings = [f"{_listed(unread)} {of_kinds}"] if unread else []
    if misnamed := unread_photographs(folder, is_misnamed):
        of_names = "not used: by content, but not by name, an image; end such a name in .jpg, .png or .webp."
        warnings.append(f"{_listed(misnamed)} {of_names}")
    if absent := absent_photographs(folder):
        warnings.append(f"{_listed(absent)} not here but only linked to, or not downloaded; put the photographs here.")
    return warnings


def _listed(paths: list[Path]) -> str:
    return f"{some_of([path.name for path in paths])} {'is' if len(paths) == 1 else 'are'}"


def _of_photograph(camera: EstimatedCamera, path: Path) -> EstimatedCamera:
    """Return the camera with its lens in pixels of the upright photograph, whose copy may be smaller."""
    short, long = sorted(read_image_size(path))
    width, height = (long, short) if camera.lens.width >= camera.lens.height else (short, long)
    return replace(camera, lens=camera.lens.scaled_to(width, height, str(path)))


def _notes(count: int, found: Reconstruction, groups: list[ImageGroup], lens: Lens) -> list[str]:
    """Return what was estimated. count: of photographs. lens: of the first camera, in pixels of its photograph."""
    cameras = found.cameras
    focal = "started from EXIF data" if all(group.is_known for group in groups) else "started from a standard lens"
    if all(group.is_fixed for group in groups):
        focal = "as given"
    error_px = found.reprojection_error_px * lens.fx / cameras[0].lens.fx
    shared = [count for count in found.matches.values() if count >= _MANY_MATCHES]
    return [
        f"cameras estimated for {len(cameras)} of {count} photographs: reprojection error "
        f"{error_px:.2f} pixels, median angle between rays {found.angle:.1f} degrees, "
        f"{len(shared)} pair{'' if len(shared) == 1 else 's'} with {_MANY_MATCHES} or more matches, focal length "
        f"{lens.fx:.0f} pixels for {lens.width}x{lens.height} ({focal}); the unit of length is arbitrary."
    ]


def _left_out(photographs: list[Path], found: Reconstruction) -> list[str]:
    """Return a warning for each reason for which photographs have no camera."""
    registered, matched = {camera.name for camera in found.cameras}, set(chain(*found.matches))
    groups: dict[str, list[Path]] = {_UNMATCHED: [], _SCARCE: [], _MISFIT: []}
    for path in photographs:
        if path.name not in registered:
            is_scarce = found.reached.get(path.name, 0) < LEAST_POINTS
            groups[_UNMATCHED if path.name not in matched else _SCARCE if is_scarce else _MISFIT].append(path)
    warnings = []
    for reason, paths in groups.items():
        counts = sorted({found.reached.get(path.name, 0) for path in paths}) or [0]
        points = f"{counts[0]} to {counts[-1]}" if len(counts) > 1 else str(counts[0] or "no")
        them = "it" if len(paths) == 1 else "them"
        warnings += [f"{_listed(paths)} left out{reason.format(points, them)}."] if paths else []
    return warnings


def _relative_path(file: Path, folder: Path) -> str:
    """Return the path of `file` relative to `folder`; an absolute path if they are on different drives.

    Symbolic links of folders are resolved, because `..` leads out of the folder that a link points to. A link to the
    file itself is kept, because its name may differ.
    """
    resolved = file.parent.resolve() / file.name
    try:
        return Path(os.path.relpath(resolved, folder.resolve())).as_posix()
    except ValueError:
        return resolved.as_posix()


def _transforms(cameras: tuple[EstimatedCamera, ...], files: list[str]) -> dict[str, Any]:
    """Return the cameras in the layout of nerfstudio, with depth bounds if there are enough points.

    The key `is_estimated` tells them from given ones; other programs do not read it.
    """
    depths = np.concatenate([camera.depths for camera in cameras])
    frames = [_frame(camera, file) for camera, file in zip(cameras, files, strict=True)]
    bounds = bounds_of_depths(depths)
    scene = {"camera_model": "OPENCV", "is_estimated": True}
    if bounds is not None:
        scene |= {"near": bounds[0] / _DEPTH_MARGIN, "far": bounds[1] * _DEPTH_MARGIN}
    return {**scene, "frames": frames}


def _frame(camera: EstimatedCamera, file: str) -> dict[str, Any]:
    lens = camera.lens
    return {
        "file_path": file,
        "w": lens.width,
        "h": lens.height,
        "fl_x": lens.fx,
        "fl_y": lens.fy,
        "cx": lens.cx,
        "cy": lens.cy,
        **{f"k{index + 1}": value for index, value in enumerate(lens.radial)},
        "transform_matrix": (camera.camera_to_world @ _OPENGL_TO_OPENCV).tolist(),
    }
