"""Take sharp, evenly spread frames from a video with PyAV (optional extra `video`)."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from fecocodec.errors import InputError, installation

VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi")
_SMALL_WIDTH = 480  # pixels; sharpness is measured on small grey frames


def is_video(path: Path) -> bool:
    """Return whether the name of a file is that of a video."""
    return path.suffix.lower() in VIDEO_SUFFIXES and not path.is_dir()


def write_sharp_frames(video: Path, folder: Path, count: int) -> None:
    """Write the sharpest frame of each of `count` equal parts of a video as PNG, named by the number of the frame.

    The video is read twice: to measure sharpness, then to write the chosen frames. Raises InputError if PyAV is
    missing, the video cannot be read, or it has fewer frames.
    """
    sharpness = [_sharpness(frame.to_ndarray(format="gray")) for frame in _frames(video)]
    if len(sharpness) < count:
        raise InputError(f"{video}: {len(sharpness)} frames, but {count} are needed; ask for fewer frames.")
    parts = np.array_split(np.arange(len(sharpness)), count)
    chosen = {int(part[np.argmax([sharpness[index] for index in part])]) for part in parts}
    for index, frame in enumerate(_frames(video)):
        if index in chosen:
            Image.fromarray(frame.to_ndarray(format="rgb24")).save(folder / f"frame{index:06d}.png", compress_level=1)


def _frames(video: Path) -> Any:
    try:
        import av
    except ImportError as error:
        raise InputError(
            f"{video}: videos are read with PyAV, which is not installed; run {installation('video')}."
        ) from error
    if video.exists() and not video.is_file():
        raise InputError(f"{video}: a pipe or a device cannot be read here; give a video file.")
    try:
        with av.open(str(video)) as container:
            if not container.streams.video:
                raise InputError(f"{video}: there is no video in this file; give a video or a folder of photographs.")
            yield from container.decode(video=0)
    except (av.error.FFmpegError, OSError) as error:
        raise InputError(f"{video}: the video cannot be read ({error.strerror}); convert it to MP4 (H.264).") from error


def _sharpness(grey: UInt8[np.ndarray, "height width"]) -> float:
    """Return the variance of the Laplacian of a reduced frame."""
    step = max(1, grey.shape[1] // _SMALL_WIDTH)
    small = grey[::step, ::step].astype(np.float64)
    inside = small[1:-1, 1:-1]
    laplacian = small[:-2, 1:-1] + small[2:, 1:-1] + small[1:-1, :-2] + small[1:-1, 2:] - 4 * inside
    return float(laplacian.var())
