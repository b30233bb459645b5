"""Cameras of the same pixels are estimated once a process, for tests of what is done with them."""

from dataclasses import replace
from pathlib import Path

from fecocodec.poses.estimated_cameras import ImageGroup, Reconstruction
from fecocodec.poses.pose_estimation import reconstruct

_found: dict[tuple[object, ...], Reconstruction] = {}


def estimated_once(
    folder: Path, groups: list[ImageGroup], workspace: Path, num_threads: int = -1, masks: Path | None = None
) -> Reconstruction:
    """Return what `reconstruct` does for two photographs without masks. Their names do not matter, but their order."""
    names = [name for group in groups for name in group.names]
    assert len(names) == 2 and masks is None
    key = tuple((group.focal_px, group.is_known, group.is_fixed) for group in groups)
    key += tuple((folder / name).read_bytes() for name in names)
    found = _found.setdefault(key, _found.get(key) or reconstruct(folder, groups, workspace, num_threads))
    cameras = tuple(replace(camera, name=name) for camera, name in zip(found.cameras, names, strict=True))
    return replace(found, cameras=cameras, matches=dict.fromkeys([(names[0], names[1])], *found.matches.values()))
