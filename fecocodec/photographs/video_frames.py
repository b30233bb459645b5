"""Take sharp frames of a moving camera from a video with PyAV (optional extra `video`)."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from fecocodec.errors import InputError, OutputError, installation
from fecocodec.photographs.colour import is_hdr
from fecocodec.photographs.lens import require_known_model
from fecocodec.photographs.video_pixels import Stream, in_srgb, is_transparent, side_data, upright

VIDEO_SUFFIXES = (
    ".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".mts", ".m2ts", ".3gp", ".3g2", ".mpg", ".mpeg", ".wmv", ".ogv",
)  # fmt: skip
_SHARPNESS_WIDTH, _CHANGE_WIDTH = 480, 96  # pixels of the small grey frames that are measured
_LEAST_CHANGE = 0.02  # mean change of a frame that is not passed over, in standard deviations of its grey levels
_BORDER_SHARPNESS = 0.5  # what sharpness counts at the borders of a part, relative to its middle
# The part of a video, and the seconds, that must be missing at its end to be worth a warning.
_LEAST_CUT, _LEAST_CUT_SECONDS = 0.05, 0.2
_DURATION = re.compile(r"(\d{1,4}):(\d\d):(\d\d(?:\.\d{1,9})?)")
_RECTILINEAR = 4  # AV_SPHERICAL_RECTILINEAR; others are panoramas


def is_video(path: Path) -> bool:
    """Return whether the name of a file is that of a video."""
    return path.suffix.lower() in VIDEO_SUFFIXES and not path.name.startswith(".") and not path.is_dir()


def require_video_extra() -> None:
    """Raise OutputError, which names the extra to install, if PyAV is missing."""
    if find_spec("av") is None:
        raise OutputError(f"writing a video needs the package av; run {installation('video')}.")


def write_sharp_frames(
    video: Path, folder: Path, count: int, *, is_most: bool = False
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Write `count` sharp frames, spread over the video, as PNG named by their number; return notes and warnings.

    Frames that hardly differ from those before are passed over; the others are divided into equal parts, of each of
    which the sharpest is taken. Frames are upright, of square pixels, deinterlaced and in sRGB. If fewer than `count`
    frames differ, all of these are taken. is_most: take all frames of a video that has no more than `count`.
    The video is read twice: to measure, then to write. Damaged frames are passed over.
    Raises InputError if PyAV is missing, the video cannot be read, it has fewer frames, or its camera stands still.
    """
    damage = _Damage()
    small = [_measured(frame.to_ndarray(format="gray")) for frame, _ in _frames(video, damage)]
    if len(small) < 2 and damage.count:
        raise InputError(_unreadable(video, damage.reason))
    if len(small) < 2:
        raise InputError(f"{video}: {len(small)} frame, but cameras are estimated from two or more; film longer.")
    of_damaged = " without damage" if damage.count else ""
    if len(small) < count and not is_most:
        raise InputError(f"{video}: {len(small)} frames{of_damaged}, but {count} are needed; ask for fewer frames.")
    moving = _moving([grey for _, grey in small])
    if len(moving) < 2:
        raise InputError(f"{video}: all {len(small)} frames are equal; film with a camera that moves.")
    chosen = _sharpest(moving, [sharpness for sharpness, _ in small], min(count, len(moving)))
    notes = list[str]()
    if len(moving) < min(count, len(small)):
        notes.append(f"{len(moving)} of {len(small)} frames differ from those before, and only these are taken.")
    for index, (frame, stream) in enumerate(_frames(video, _Damage())):
        if index == 0 and is_hdr(stream.transfer):
            notes.append("the frames are of HDR video; their colours are tone-mapped to sRGB.")
        if index == 0 and is_transparent(frame, stream):
            notes.append("the opacity of the video is not read; to cut out what it hides, give PNG files with opacity.")
        if index in chosen:
            picture = Image.fromarray(upright(in_srgb(frame, stream), stream, frame))
            picture.save(folder / f"frame{index:06d}.png", compress_level=1)
    return tuple(notes), damage.warnings()


@dataclass
class _Damage:
    """What is missing of a video. count: of packets and frames that cannot be decoded. reason: of the last one.

    stated, found: length of the video in seconds, by what it says and by its last frame; 0 if it says nothing.
    """

    count: int = 0
    reason: str | None = None
    stated: float = 0.0
    found: float = 0.0

    def warnings(self) -> tuple[str, ...]:
        sentences = list[str]()
        if self.count:
            places = f"{self.count} place{'' if self.count == 1 else 's'}"
            sentences.append(f"the video is damaged at {places}, and its frames there are passed over; copy it again.")
        if self.stated - self.found > max(_LEAST_CUT_SECONDS, _LEAST_CUT * self.stated):
            sentences.append(
                f"the video ends after {self.found:.1f} of its {self.stated:.1f} seconds, as a file that is cut short; "
                "copy it again to use all of it."
            )
        return tuple(sentences)


def _frames(video: Path, damage: _Damage) -> Iterator[tuple[Any, Stream]]:
    """Yield the frames that can be decoded. damage: gets what is missing."""
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
            # A picture of the cover may come first. Files need not state their number of frames, which is then 0.
            stream: Any = max(container.streams.video, key=lambda one: (one.frames, one.width * one.height))
            stream.thread_type = "AUTO"
            coded = stream.codec_context
            start, damage.stated = _stated_span(container, stream)
            for frame in _decoded(container, stream, damage):
                projection = side_data(frame, "SPHERICAL")
                if projection is not None and np.frombuffer(projection, np.int32)[0] != _RECTILINEAR:
                    require_known_model("EQUIRECTANGULAR", str(video))
                last = float(frame.duration * frame.time_base or 1 / (stream.average_rate or 25))
                damage.found = max(damage.found, (frame.time or 0.0) - start + last)
                aspect = stream.sample_aspect_ratio or coded.sample_aspect_ratio or Fraction(1)
                has_alpha = stream.metadata.get("alpha_mode") == "1"
                yield frame, Stream(Fraction(aspect), int(coded.color_primaries), int(coded.color_trc), has_alpha)
    except (av.error.FFmpegError, OSError) as error:
        raise InputError(_unreadable(video, error.strerror)) from error


def _stated_span(container: Any, stream: Any) -> tuple[float, float]:
    """Return the first time, and the length from there, that a file states for a stream; in seconds, 0 for none.

    AVI states a number of frames. Matroska states the last time of all streams, and of each one in a tag at the end.
    """
    if container.format.name == "avi" and stream.average_rate:
        return 0.0, float(stream.frames / stream.average_rate)
    if stream.duration:
        return float((stream.start_time or 0) * stream.time_base), float(stream.duration * stream.time_base)
    if tag := _DURATION.fullmatch(stream.metadata.get("DURATION", "")):
        hours, minutes, seconds = (float(number) for number in tag.groups())
        return 0.0, 3600 * hours + 60 * minutes + seconds
    return 0.0, (container.duration or 0) / 1e6


def _decoded(container: Any, stream: Any, damage: _Damage) -> Iterator[Any]:
    """Yield the frames of a stream without damage, and count the others."""
    from av.error import FFmpegError

    packets = container.demux(stream)
    while True:
        try:
            frames = next(packets).decode()
        except StopIteration:
            return
        except FFmpegError as error:
            damage.count, damage.reason = damage.count + 1, error.strerror
            continue
        for frame in frames:
            if frame.is_corrupt:
                damage.count += 1
            else:
                yield frame


def _unreadable(video: Path, reason: str | None) -> str:
    return (
        f"{video}: the video cannot be read ({reason or 'damaged frames'}); it is damaged, cut short or of an unknown "
        "kind: copy it again, or convert it to MP4 (H.264)."
    )


def _measured(grey: UInt8[np.ndarray, "height width"]) -> tuple[float, Float[np.ndarray, "rows columns"]]:
    """Return the variance of the Laplacian of a reduced frame, and the means of its blocks."""
    step = max(1, grey.shape[1] // _SHARPNESS_WIDTH)
    small = grey[::step, ::step].astype(np.float64)
    inside = small[1:-1, 1:-1]
    laplacian = small[:-2, 1:-1] + small[2:, 1:-1] + small[1:-1, :-2] + small[1:-1, 2:] - 4 * inside
    side = max(1, grey.shape[1] // _CHANGE_WIDTH)
    rows, columns = (length // side for length in grey.shape)
    blocks = grey[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return float(laplacian.var()), blocks.mean(axis=(1, 3), dtype=np.float32)


def _moving(greys: list[Float[np.ndarray, "rows columns"]]) -> list[int]:
    """Return the indices of frames that differ from the one before among them."""
    kept = [0]
    for index, grey in enumerate(greys):
        change = np.abs(grey - greys[kept[-1]]).mean()
        if change > _LEAST_CHANGE * max(1.0, float(grey.std())):
            kept.append(index)
    return kept


def _sharpest(frames: list[int], sharpness: list[float], count: int) -> set[int]:
    """Return the sharpest frame of each of `count` equal parts; frames near the borders of a part count less."""
    chosen = set()
    for part in np.array_split(np.array(frames), count):
        from_middle = np.abs(np.arange(len(part)) - (len(part) - 1) / 2) / (len(part) / 2)
        weights = 1 - (1 - _BORDER_SHARPNESS) * from_middle
        chosen.add(int(part[np.argmax(weights * [sharpness[index] for index in part])]))
    return chosen
