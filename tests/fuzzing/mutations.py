"""Changes to streams, from a flipped bit to checksums that hold over nonsense."""

import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random

VECTORS = Path(__file__).resolve().parents[2] / "bitstream_spec" / "vectors"
FIELD_OFFSETS = (8, 9, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27)
TELLING_BYTES = (0, 1, 2, 3, 15, 16, 17, 32, 64, 127, 128, 254, 255)


@dataclass(frozen=True)
class Mutation:
    """One change. where: in [0, 1), of the stream's length. value: in [0, 2^16), what it means depends on the kind."""

    kind: str
    where: float
    value: int


def flip(data: bytearray, at: int, value: int) -> bytearray:
    data[at] ^= 1 << value % 8
    return data


def set_byte(data: bytearray, at: int, value: int) -> bytearray:
    data[at] = value % 256
    return data


def cut(data: bytearray, at: int, value: int) -> bytearray:
    return data[:at]


def insert(data: bytearray, at: int, value: int) -> bytearray:
    return data[:at] + bytes([value % 256]) * (1 + value // 256) + data[at:]


def delete(data: bytearray, at: int, value: int) -> bytearray:
    return data[:at] + data[at + 1 + value % 64 :]


def repeat(data: bytearray, at: int, value: int) -> bytearray:
    return data[:at] + data[at : at + 1 + value % 256] * 2 + data[at + 1 + value % 256 :]


def set_field(data: bytearray, at: int, value: int) -> bytearray:
    """A byte of the header's fields, to what lies at a limit."""
    offset = FIELD_OFFSETS[at % len(FIELD_OFFSETS)]
    if offset < len(data):
        data[offset] = TELLING_BYTES[value % len(TELLING_BYTES)]
    return data


def set_length(data: bytearray, at: int, value: int) -> bytearray:
    """The length of a section, to anything up to four bytes long."""
    starts = section_starts(data)
    if starts:
        start = starts[at % len(starts)]
        data[start + 1 : start + 5] = struct.pack("<I", value << value % 17)
    return data


def move_section(data: bytearray, at: int, value: int) -> bytearray:
    """A section taken out, and put in again somewhere else or not at all."""
    starts = [*section_starts(data), len(data)]
    if len(starts) < 3:
        return data
    number = at % (len(starts) - 1)
    section = data[starts[number] : starts[number + 1]]
    rest = data[: starts[number]] + data[starts[number + 1] :]
    target = starts[value % len(starts)]
    return rest if value % 5 == 0 else rest[:target] + section + rest[target:]


def bend_payload(data: bytearray, at: int, value: int) -> bytearray:
    """A byte of a coded latent, or of what else the section at that place holds."""
    starts = section_starts(data)
    if not starts:
        return data
    start = starts[value % len(starts)]
    length = int.from_bytes(data[start + 1 : start + 5], "little")
    place = start + 9 + at % max(length, 1)
    if place < len(data):
        data[place] ^= 1 + value // 16 % 255
    return data


def bend_cameras(data: bytearray, at: int, value: int) -> bytearray:
    """A byte of the cameras changed before compression."""
    starts = section_starts(data)
    if not starts or data[starts[0]] != 0x90:
        return data
    begin, length = starts[0] + 9, int.from_bytes(data[starts[0] + 1 : starts[0] + 5], "little")
    try:
        content = bytearray(zlib.decompress(bytes(data[begin : begin + length]), -15))
    except zlib.error:
        return data
    if not content:
        return data
    content[at % len(content)] = value % 256
    compressor = zlib.compressobj(9, zlib.DEFLATED, -15)
    payload = compressor.compress(bytes(content)) + compressor.flush()
    head = bytes([0x90]) + struct.pack("<I", len(payload)) + bytes(4)
    return data[: starts[0]] + head + payload + data[begin + length :]


CHANGES: dict[str, Callable[[bytearray, int, int], bytearray]] = {
    change.__name__: change
    for change in (
        flip,
        set_byte,
        cut,
        insert,
        delete,
        repeat,
        set_field,
        set_length,
        move_section,
        bend_payload,
        bend_cameras,
    )
}


def apply(data: bytes, mutations: tuple[Mutation, ...], seals: bool) -> bytes:
    """The stream after these changes; where `seals`, its checksums hold again, as far as there is structure."""
    changed = bytearray(data)
    for mutation in mutations:
        if not changed:
            break
        changed = CHANGES[mutation.kind](changed, int(mutation.where * len(changed)), mutation.value)
    return sealed(changed) if seals else bytes(changed)


def sealed(data: bytearray) -> bytes:
    """Compute the checksums of the header and of every section that can be parsed again."""
    end = header_end(data)
    if end is None:
        return bytes(data)
    data[end - 4 : end] = struct.pack("<I", zlib.crc32(bytes(data[: end - 4])))
    for start in section_starts(data):
        length = int.from_bytes(data[start + 1 : start + 5], "little")
        found = zlib.crc32(bytes(data[start : start + 5] + data[start + 9 : start + 9 + length]))
        data[start + 5 : start + 9] = struct.pack("<I", found)
    return bytes(data)


def header_end(data: bytes | bytearray) -> int | None:
    end = 32 + 8 * min(data[19], 2) if len(data) > 19 else len(data) + 1
    return end if end <= len(data) else None


def section_starts(data: bytes | bytearray) -> list[int]:
    """Where sections begin, as far as lengths lead within the stream."""
    at, starts = header_end(data), list[int]()
    while at is not None and at + 9 <= len(data) and len(starts) < 20:
        starts.append(at)
        at += 9 + int.from_bytes(data[at + 1 : at + 5], "little")
    return starts


@cache
def corpus() -> tuple[bytes, ...]:
    """The streams of the tiny model, faulty ones included, in the order of their names."""
    files = (path for path in sorted(VECTORS.glob("*/*.fcs")) if not path.stem.startswith("scene-"))
    return tuple(data for data in (path.read_bytes() for path in files) if len(data) < 4000)


def random_mutant(random: Random, streams: Sequence[bytes]) -> bytes:
    """One to four changes to one of the streams; every other time its checksums hold, to get further."""
    kinds = (*CHANGES, *("bend_payload", "flip", "set_byte") * 3)
    mutations = tuple(
        Mutation(kinds[int(random.random() * len(kinds))], random.random(), int(random.random() * 2**16))
        for _ in range(1 + int(random.random() ** 2 * 4))
    )
    return apply(streams[int(random.random() * len(streams))], mutations, random.random() < 0.5)
