"""One file with the AVIF images of a scene and its cameras: AV1 payloads without the 275 bytes of container of each.

Layout: number of images, height, width, length of the camera section, and length of every payload but the last, as
LEB128; the camera section of FORMAT.md, section 6; the payloads. The receiver builds the containers again (ISO/IEC
23008-12; AV1 Image File Format 1.1.0), so any AVIF decoder reads the images.
"""

from collections.abc import Sequence

from fecocodec.errors import InputError

_PLACE = "AVIF scene"
_BROKEN = f"{_PLACE}: not a file of `pack_avif`; encode the images again."


def pack_avif(images: Sequence[bytes], size: tuple[int, int], cameras: bytes) -> bytes:
    """Return the file. images: AVIF files of one colour item with 4:2:0 chroma. size: (height, width) in pixels."""
    payloads = [av1_payload(image) for image in images]
    numbers = (len(images), *size, len(cameras), *(len(payload) for payload in payloads[:-1]))
    return b"".join((*map(_leb128, numbers), cameras, *payloads))


def unpack_avif(data: bytes) -> tuple[list[bytes], tuple[int, int], bytes]:
    """Return AVIF files, (height, width) and the camera section. Raises InputError if the file is cut short."""
    (count, height, width, num_camera_bytes), start = _numbers(data, 0, 4)
    lengths, start = _numbers(data, start, count - 1)
    cameras, start = data[start : start + num_camera_bytes], start + num_camera_bytes
    last = len(data) - start - sum(lengths)
    if last <= 0:
        raise InputError(_BROKEN)
    images = []
    for length in (*lengths, last):
        images.append(avif_around(data[start : start + length], height, width))
        start += length
    return images, (height, width), cameras


def av1_payload(image: bytes) -> bytes:
    """Return the media data of an AVIF file. Raises InputError if it has none."""
    start = 0
    while start + 8 <= len(image):
        length, kind = int.from_bytes(image[start : start + 4]), image[start + 4 : start + 8]
        if kind == b"mdat":
            return image[start + 8 : start + length]
        start += max(length, 8)
    raise InputError(f"{_PLACE}: an image has no media data; encode it as AVIF.")


def avif_around(payload: bytes, height: int, width: int) -> bytes:
    """Return an AVIF file of one image. payload: AV1, 8 bits per sample, 4:2:0, beginning with a temporal delimiter and
    the sequence header of a still picture, as libavif writes it.
    """
    profile, level = payload[4] >> 5, (payload[4] & 7) << 2 | payload[5] >> 6
    properties = (
        _box(b"ispe", bytes(4), width.to_bytes(4), height.to_bytes(4)),
        _box(b"pixi", bytes(4), bytes((3, 8, 8, 8))),
        _box(b"av1C", bytes((0x81, profile << 5 | level, 0x0C, 0))),
        _box(b"colr", b"nclx", bytes((0, 2, 0, 2, 0, 6, 0x80))),  # BT.601 matrix, full range
    )
    associations = bytes((4, 1, 2, 0x83, 4))  # of item 1 with the four properties; the third is essential
    file_type = _box(b"ftyp", b"avif", bytes(4), b"avifmif1miafMA1B")

    def meta(offset: int) -> bytes:
        return _box(
            b"meta",
            bytes(4),
            _box(b"hdlr", bytes(8), b"pict", bytes(13)),
            _box(b"pitm", bytes(4), b"\0\1"),
            _box(b"iloc", bytes(4), b"\x44\0\0\1\0\1\0\0\0\1", offset.to_bytes(4), len(payload).to_bytes(4)),
            _box(b"iinf", bytes(4), b"\0\1", _box(b"infe", b"\2\0\0\0\0\1\0\0av01Color\0")),
            _box(b"iprp", _box(b"ipco", *properties), _box(b"ipma", bytes(4), b"\0\0\0\1\0\1", associations)),
        )

    return file_type + meta(len(file_type) + len(meta(0)) + 8) + _box(b"mdat", payload)


def _box(kind: bytes, *parts: bytes) -> bytes:
    content = b"".join(parts)
    return (len(content) + 8).to_bytes(4) + kind + content


def _leb128(value: int) -> bytes:
    found = bytearray()
    while value >= 128:
        found.append(value & 127 | 128)
        value >>= 7
    return bytes((*found, value))


def _numbers(data: bytes, start: int, count: int) -> tuple[list[int], int]:
    """Return `count` numbers in LEB128 and the position after them. Raises InputError at the end of the data."""
    values = []
    for _ in range(count):
        value, shift, more = 0, 0, True
        while more:
            if start >= len(data):
                raise InputError(_BROKEN)
            value, more = value | (data[start] & 127) << shift, data[start] >= 128
            start, shift = start + 1, shift + 7
        values.append(value)
    return values, start
