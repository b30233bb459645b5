"""Adjust the cameras of a capture before photographs are chosen by them, if those of a sample do not fit."""

from dataclasses import replace

import numpy as np
import torch

from fecocodec.camera_files.posed_photographs import PosedPhotographs
from fecocodec.captures.chosen_photographs import framed
from fecocodec.captures.scene_folder import Masks, read_readable
from fecocodec.captures.view_choice import is_usable
from fecocodec.codec.roles import LEAST_FOR_CHOICE, usable_cameras
from fecocodec.geometry.bundle_adjustment import Adjusted, adjusted
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth_range import facing_baselines
from fecocodec.geometry.sparse_matches import CORNER_SIDE, corners_of

_SAMPLES, _BESIDE = 2, 2  # photographs that are looked at first, and the nearest ones of each


def with_fitting_cameras(scene: PosedPhotographs, masks: Masks) -> tuple[PosedPhotographs, Adjusted | None]:
    """Return the scene with cameras at which points that look alike meet, and what was done; the same one if they fit.

    Photographs that cannot be read keep their cameras, and so do all of up to four, among which nothing is chosen.
    """
    found = [index for index, photograph in enumerate(scene.photographs) if is_usable(photograph)]
    usable = list(usable_cameras(scene.photographs, found)[0])
    if len(usable) < LEAST_FOR_CHOICE or _fit(scene, _sample(scene, usable), masks)[1] is None:
        return scene, None
    indices, better = _fit(scene, usable, masks)
    if better is None:
        return scene, None
    photographs = list(scene.photographs)
    for index, pose in zip(indices, better.cameras.extrinsics.double().numpy(), strict=True):
        photographs[index] = replace(photographs[index], camera_to_world=pose)
    return replace(scene, photographs=photographs), better


def _sample(scene: PosedPhotographs, usable: list[int]) -> list[int]:
    """Return some photographs, and those that were taken nearest to each."""
    poses = np.stack([scene.photographs[index].camera_to_world for index in usable])
    unknown = torch.eye(3).expand(len(poses), 3, 3)
    baselines = facing_baselines(Cameras.in_float32(poses, unknown, torch.nan, torch.nan))
    middles = [(2 * part + 1) * len(usable) // (2 * _SAMPLES) for part in range(_SAMPLES)]
    chosen = {view for middle in middles for view in (middle, *baselines[middle].argsort()[:_BESIDE].tolist())}
    return [usable[view] for view in sorted(chosen)]


def _fit(scene: PosedPhotographs, indices: list[int], masks: Masks) -> tuple[list[int], Adjusted | None]:
    """Return which of the photographs could be read, and their cameras if they fit better."""
    chosen = framed(scene, [scene.photographs[index] for index in indices], (CORNER_SIDE, CORNER_SIDE), [])
    views, readable = read_readable(chosen, indices, masks)
    if views is None:
        return [], None
    return readable, adjusted(views.cameras, corners_of(views.images, views.ignored), photographs=views)
