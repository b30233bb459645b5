"""Frames of a video: evenly spread, and the sharpest of their part."""

import os
import struct
import sys
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageFilter

from fecocodec.errors import InputError
from fecocodec.photographs.video_frames import is_video, write_sharp_frames

av = pytest.importorskip("av")


def write_video(path: Path, num_frames: int, sharp: set[int], **options: str) -> None:
    """Write textured frames, all blurred but those in `sharp`."""
    texture = Image.fromarray(np.random.default_rng(0).integers(0, 256, (24, 32, 3), dtype=np.uint8))
    texture = texture.resize((192, 144), Image.Resampling.NEAREST)
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 192, 144, "yuv420p", 8_000_000
        for index in range(num_frames):
            image = texture if index in sharp else texture.filter(ImageFilter.GaussianBlur(3))
            for packet in stream.encode(av.VideoFrame.from_image(image)):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)


def test_the_sharpest_frame_of_each_part_is_written(tmp_path):
    write_video(tmp_path / "clip.mp4", 30, sharp={4, 17, 22})
    (tmp_path / "frames").mkdir()
    write_sharp_frames(tmp_path / "clip.mp4", tmp_path / "frames", 3)
    assert sorted(path.name for path in (tmp_path / "frames").iterdir()) == [
        "frame000004.png",
        "frame000017.png",
        "frame000022.png",
    ]


def test_frames_of_a_short_video(tmp_path):
    clip = tmp_path / "clip.mp4"
    write_video(clip, 3, sharp={1})
    with pytest.raises(InputError, match=r"3 frames, but 8 are needed"):
        write_sharp_frames(clip, tmp_path, 8)
    assert write_sharp_frames(clip, tmp_path, 8, is_most=True) == ((), ())
    assert len(list(tmp_path.glob("*.png"))) == 3
    write_video(clip, 1, sharp=set())
    with pytest.raises(InputError, match=r"1 frame, but cameras are estimated from two or more; film longer\.$"):
        write_sharp_frames(clip, tmp_path, 8, is_most=True)


def test_a_picture_of_the_cover_is_not_taken_for_the_video(tmp_path):
    with av.open(str(tmp_path / "clip.mov"), "w") as container:
        cover, video = (container.add_stream(codec, rate=10) for codec in ("mjpeg", "mpeg4"))
        cover.width, cover.height, cover.pix_fmt = 320, 240, "yuvj420p"
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        for stream, levels in ((cover, [0]), (video, [0, 90, 180])):
            pictures = [Image.new("RGB", (stream.width, stream.height), (level, 0, 0)) for level in levels]
            frames = [av.VideoFrame.from_image(picture).reformat(format=stream.pix_fmt) for picture in pictures]
            for frame in (*frames, None):
                container.mux(stream.encode(frame))
    assert write_sharp_frames(tmp_path / "clip.mov", tmp_path, 8, is_most=True) == ((), ())
    assert [Image.open(path).size for path in tmp_path.glob("*.png")] == 3 * [(64, 48)]


def positions(path: Path) -> list[tuple[int, int]]:
    """Offset and size of each packet."""
    with av.open(str(path)) as container:
        return [(packet.pos, packet.size) for packet in container.demux(video=0) if packet.size]


def damage(path: Path, places: list[tuple[int, int]]) -> None:
    data = bytearray(path.read_bytes())
    for position, size in places:
        data[position : position + size] = bytes(size)
    path.write_bytes(data)


def test_damaged_frames_are_passed_over_and_counted(tmp_path):
    clip = tmp_path / "clip.mp4"
    write_video(clip, 30, sharp=set(range(0, 30, 2)))
    places = positions(clip)
    damage(clip, [places[7], places[12]])
    warning = "the video is damaged at 2 places, and its frames there are passed over; copy it again."
    assert write_sharp_frames(clip, tmp_path, 40, is_most=True)[1] == (warning,)
    assert len(list(tmp_path.glob("*.png"))) == 28
    with pytest.raises(InputError, match="28 frames without damage, but 30 are needed; ask for fewer frames"):
        write_sharp_frames(clip, tmp_path, 30)
    damage(clip, places[1:])
    with pytest.raises(InputError, match=r"clip\.mp4: the video cannot be read \(Invalid data .*copy it again"):
        write_sharp_frames(clip, tmp_path, 40, is_most=True)


@pytest.mark.parametrize("kind", ["mp4", "mkv", "avi"])
def test_a_video_that_is_cut_short_is_said_to_be(kind, tmp_path):
    clip = tmp_path / f"clip.{kind}"
    write_video(clip, 30, sharp=set(range(0, 30, 2)), **({"movflags": "faststart"} if kind == "mp4" else {}))
    clip.write_bytes(clip.read_bytes()[: sum(positions(clip)[22])])
    notes, (warning,) = write_sharp_frames(clip, tmp_path, 40, is_most=True)
    seconds = "2.2" if kind == "mkv" else "2.3"  # a cut block of Matroska is left out, the last packet of others used
    assert notes == () and warning == (
        f"the video ends after {seconds} of its 3.0 seconds, as a file that is cut short; copy it again to use all of "
        "it."
    )


def box(kind: bytes, *parts: bytes) -> bytes:
    return struct.pack(">I", 8 + len(b"".join(parts))) + kind + b"".join(parts)


def test_a_video_of_360_degrees_is_refused(tmp_path):
    """The box `sv3d` of Spherical Video V2, at the end of the sample entry; `moov` comes last."""
    clip = tmp_path / "clip.mp4"
    write_video(clip, 3, sharp={1})
    flags = bytes(4)
    shape = box(b"proj", box(b"prhd", flags, bytes(12)), box(b"equi", flags, bytes(16)))
    added = box(b"sv3d", box(b"svhd", flags, b"\0"), shape)
    data = bytearray(clip.read_bytes())
    outer = [data.rindex(kind) - 4 for kind in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd", b"mp4v")]
    end = outer[-1] + struct.unpack_from(">I", data, outer[-1])[0]
    for start in outer:
        struct.pack_into(">I", data, start, struct.unpack_from(">I", data, start)[0] + len(added))
    clip.write_bytes(data[:end] + added + data[end:])
    with pytest.raises(InputError, match=r"clip\.mp4: panoramas \(EQUIRECTANGULAR\) are not read; cut them into persp"):
        write_sharp_frames(clip, tmp_path, 2)


def test_sound_that_is_longer_than_its_video_is_no_cut(tmp_path):
    with av.open(str(tmp_path / "clip.mkv"), "w") as container:
        video, sound = container.add_stream("mpeg4", rate=10), container.add_stream("pcm_s16le", rate=8000)
        video.width, video.height, video.pix_fmt, sound.layout = 64, 48, "yuv420p", "mono"
        for level in (0, 90, 180):
            frame = av.VideoFrame.from_image(Image.new("RGB", (64, 48), (level, 0, 0))).reformat(format="yuv420p")
            container.mux(video.encode(frame))
        silence = av.AudioFrame.from_ndarray(np.zeros((1, 16000), np.int16), format="s16", layout="mono")
        silence.sample_rate, silence.pts = 8000, 0
        container.mux([*video.encode(), *sound.encode(silence), *sound.encode()])
    assert write_sharp_frames(tmp_path / "clip.mkv", tmp_path, 8, is_most=True) == ((), ())


@pytest.mark.parametrize("kind", ["file", "pipe", "device"])
def test_what_is_no_video_is_refused(kind, tmp_path):
    """Reading a pipe that nobody writes to blocks."""
    path = tmp_path / "clip.mp4"
    if kind == "file":
        path.write_bytes(b"no video" * 100)
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    sentence = r"the video cannot be read \([^'\[]+\); it is damaged, cut short"
    sentence = sentence if kind == "file" else r"a pipe or a device cannot be read here; give a video file\."
    with pytest.raises(InputError, match=rf"clip\.mp4: {sentence}"):
        write_sharp_frames(path, tmp_path, 2)


def test_videos_are_known_by_their_ending_and_need_an_extra(tmp_path, monkeypatch):
    assert is_video(Path("clip.MP4")) and not is_video(Path("photos"))
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(InputError, match=r"pip install '\.\[video\]'"):
        write_sharp_frames(tmp_path / "clip.mp4", tmp_path, 2)


def test_frames_with_exif_data_are_read_and_turned(tmp_path):
    exif, clip = Image.Exif(), tmp_path / "clip.mp4"
    exif[0x0112] = 6
    with av.open(str(tmp_path / "raw.avi"), "w") as container:
        stream = container.add_stream("mjpeg", rate=10)
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuvj420p"
        for index in range(3):
            picture = Image.new("RGB", (96, 64), (0, 80 * index, 0))
            picture.paste("red", (0, 0, 48, 32))
            data = BytesIO()
            picture.save(data, "JPEG", exif=exif, quality=95)
            packet = av.Packet(data.getvalue())
            packet.stream, packet.pts, packet.dts = stream, index, index
            container.mux(packet)
        clip.write_bytes(data.getvalue())
    write_sharp_frames(tmp_path / "raw.avi", tmp_path, 8, is_most=True)
    turned = np.asarray(Image.open(tmp_path / "frame000002.png"))
    assert turned.shape == (96, 64, 3)
    assert turned[20, 50, 0] > 200 and turned[20, 10, 0] < 50  # the corner above on the left is on the right
    with pytest.raises(InputError, match=r"clip\.mp4: 1 frame, but cameras are estimated from two or more"):
        write_sharp_frames(clip, tmp_path, 8, is_most=True)


@pytest.mark.parametrize(("kind", "codec", "pixels"), [("mov", "qtrle", "argb"), ("webm", "libvpx-vp9", "yuva420p")])
def test_opacity_that_is_not_read_is_noted(kind, codec, pixels, tmp_path):
    with av.open(str(tmp_path / f"clip.{kind}"), "w") as container:
        stream = container.add_stream(codec, rate=10)
        stream.width, stream.height, stream.pix_fmt = 96, 64, pixels
        for level in (0, 120, 240):
            picture = np.full((64, 96, 4), level, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgba").reformat(format=pixels)))
        container.mux(stream.encode(None))
    (note,), warnings = write_sharp_frames(tmp_path / f"clip.{kind}", tmp_path, 8, is_most=True)
    assert note.startswith("the opacity of the video is not read; to cut out") and warnings == ()
