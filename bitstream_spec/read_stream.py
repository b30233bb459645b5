"""Second reader of `.fcs` streams, written from FORMAT.md alone: prints address | length | value | meaning.

Usage: python read_stream.py FILE [WEIGHTS]
With the receiver's weights file of the stream's model, it also decodes the symbols (read_symbols.py, slow).
It needs the standard library and zstandard. Section numbers in docstrings are those of FORMAT.md, whose order the code
follows. It shares no code with the product, so that differences between the two reveal errors.
"""

import hashlib
import json
import math
import struct
import sys
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import read_symbols
import zstandard
from read_symbols import Stage

CAMERAS, COVERAGE, FADING, B1, B2, DETAIL, METADATA = 0x90, 0x98, 0x9C, 0xA0, 0xB0, 0xB8, 0x40
NAMES = {
    CAMERAS: "cameras",
    COVERAGE: "coverage",
    FADING: "fading",
    B1: "B1",
    B2: "B2",
    DETAIL: "detail",
    METADATA: "metadata",
}
LONGEST = {CAMERAS: 2048, COVERAGE: 2**18, FADING: 2**15, METADATA: 65536}  # other kinds: 2^26


class RefusedError(Exception):
    """The stream breaks a rule of FORMAT.md."""


class Field(NamedTuple):
    """One row of the output. address, length: in bytes; fields inside compressed data have the address of that data."""

    address: int
    length: int
    value: Any
    meaning: str


class Contents(NamedTuple):
    """Content of a stream.

    rotations, centres: per view. intrinsics: (fx, fy, cx, cy) per view. detail: (step, payload).
    """

    fields: list[Field]
    header: dict[str, Any]
    near: float
    far: float
    intrinsics: list[tuple[float, ...]]
    rotations: list[tuple[float, ...]]
    centres: list[tuple[float, ...]]
    payloads: list[bytes]
    coverage: bytes | None
    fading: bytes | None
    detail: tuple[int, bytes] | None
    metadata: dict[str, Any] | None


class Cursor:
    """Reads fields of the stream in order and records them."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.address = 0
        self.fields: list[Field] = []

    def take(self, length: int, meaning: str) -> bytes:
        if self.address + length > len(self.data):
            raise RefusedError(
                f"byte {self.address}: the stream ends after {len(self.data)} bytes, within the {meaning}"
            )
        raw = self.data[self.address : self.address + length]
        self.fields.append(Field(self.address, length, raw, meaning))
        self.address += length
        return raw

    def number(self, length: int, meaning: str) -> int:
        value = int.from_bytes(self.take(length, meaning), "little")
        self.fields[-1] = self.fields[-1]._replace(value=value)
        return value


def require(condition: bool, address: int, sentence: str) -> None:
    if not condition:
        raise RefusedError(f"byte {address}: {sentence}")


def read(data: bytes) -> Contents:
    """Read a whole stream (section 9)."""
    cursor = Cursor(data)
    header = read_header(cursor)
    sections = read_sections(cursor, header)
    require(cursor.address == len(data), cursor.address, "bytes follow the last section")
    for kind in [CAMERAS, B1, B2][: 1 + header["stages"]]:
        require(kind in sections, cursor.address, f"there is no section {NAMES[kind]}")
    near, far, intrinsics, rotations, centres = read_cameras(cursor, *sections[CAMERAS], header["views"])
    check_cameras(sections[CAMERAS][0], near, far, intrinsics, rotations, centres)
    coverage = read_coverage(cursor, *sections[COVERAGE], header) if COVERAGE in sections else None
    fading = read_fading(cursor, *sections[FADING], header) if FADING in sections else None
    detail = read_detail(cursor, *sections[DETAIL]) if DETAIL in sections else None
    metadata = read_metadata(cursor, *sections[METADATA]) if METADATA in sections else None
    payloads = [sections[kind][1] for kind in [B1, B2][: header["stages"]]]
    cameras = near, far, intrinsics, rotations, centres
    return Contents(cursor.fields, header, *cameras, payloads, coverage, fading, detail, metadata)


def read_header(cursor: Cursor) -> dict[str, Any]:
    """Section 4."""
    signature = cursor.take(8, "signature")
    require(signature == bytes.fromhex("89 46 43 53 0d 0a 1a 0a"), 0, "this is no .fcs signature")
    header: dict[str, Any] = {}
    header["major"] = cursor.number(1, "major version")
    require(header["major"] == 2, 8, f"major version {header['major']} is not 2")
    header["minor"] = cursor.number(1, "minor version")
    header["model_id"] = cursor.take(8, "model id")
    header["views"] = cursor.number(1, "number of views")
    header["stages"] = cursor.number(1, "number of stages")
    require(header["stages"] in (1, 2), 19, f"{header['stages']} stages are not 1 or 2")
    header["height"] = cursor.number(2, "height in pixels")
    header["width"] = cursor.number(2, "width in pixels")
    header["lambda_q"] = cursor.number(2, "lambda_q of the last stage: lambda = 1e-5 * exp(lambda_q / 256)")
    header["sections"] = cursor.number(1, "number of sections")
    header["excess"] = cursor.number(1, "excess of stage 1: its lambda_q is 2 * excess more")
    header["digests"] = [cursor.take(8, f"symbol digest of stage {stage + 1}") for stage in range(header["stages"])]
    computed = zlib.crc32(cursor.data[: cursor.address])
    require(cursor.number(4, "CRC-32 of the header") == computed, 0, "the CRC-32 of the header does not hold")
    check_limits(header)
    return header


def check_limits(header: dict[str, Any]) -> None:
    """Sections 4 and 10."""
    require(1 <= header["views"] <= 16, 18, "the number of views is not 1 to 16")
    require(64 <= header["height"] <= 1024, 20, "the height is not 64 to 1024")
    require(64 <= header["width"] <= 1024, 22, "the width is not 64 to 1024")
    require(header["lambda_q"] <= 1768, 24, "lambda_q is above 1768")
    require(header["excess"] == 0 or header["stages"] == 2, 27, "there is an excess of stage 1 and no stage 2")
    require(1 + header["stages"] <= header["sections"] <= 16, 26, "the number of sections is not 1 + stages to 16")


def read_sections(cursor: Cursor, header: dict[str, Any]) -> dict[int, tuple[int, bytes]]:
    """Section 5: address and payload of each kind."""
    sections: dict[int, tuple[int, bytes]] = {}
    last_number = -1
    for _ in range(header["sections"]):
        start = cursor.address
        kind = cursor.number(1, "kind of section")
        name = NAMES.get(kind, f"unknown {kind:#04x}")
        cursor.fields[-1] = cursor.fields[-1]._replace(meaning=f"kind of section: {name}")
        length = cursor.number(4, f"{name}: length of payload")
        stored = cursor.number(4, f"{name}: CRC-32")
        require(length <= LONGEST.get(kind, 2**26), start, f"the length of section {name} is over its limit")
        payload = cursor.take(length, f"{name}: payload")
        computed = zlib.crc32(cursor.data[start : start + 5] + payload)
        require(stored == computed, start, f"the CRC-32 of section {name} does not hold")
        require(kind in NAMES or kind ^ 0x80 not in NAMES, start, f"section {name} has the wrong critical bit")
        require(kind in NAMES or kind < 0x80, start, f"section {name} is critical")
        require(kind & 0x7F > last_number, start, f"section {name} is out of order or appears twice")
        require(kind != B2 or header["stages"] == 2, start, "there is a B2 in a stream of one stage")
        last_number = kind & 0x7F
        sections[kind] = start, payload
    return sections


def read_cameras(cursor: Cursor, start: int, payload: bytes, views: int) -> tuple[Any, ...]:
    """Section 6.1: near, far, intrinsics, rotations, centres."""
    content = inflate(start, payload, "cameras", 1 + 4 * (2 + 4 * views + 12 * views))
    require(len(content) > 0 and content[0] in (1, views), start, "the sets of intrinsics are not 1 or one a view")
    sets = content[0]
    count = 2 + 4 * sets + 12 * views
    require(len(content) == 1 + 4 * count, start, "the cameras do not inflate to the right size")
    words = [bytes(content[1 + plane * count + i] for plane in range(4)) for i in range(count)]
    cursor.fields.append(Field(start + 9, len(payload), sets, "inflated: sets of intrinsics"))

    def floats(first: int, number: int) -> list[float]:
        return [struct.unpack(">f", word)[0] for word in words[first : first + number]]

    near, far = floats(0, 2)
    intrinsics = list(zip(*(floats(2 + part * sets, sets) for part in range(4)), strict=True)) * (views // sets)
    poses = 2 + 4 * sets
    rotations = [
        read_rotation([int.from_bytes(words[poses + part * views + view], "big") for part in range(9)])
        for view in range(views)
    ]
    centres = list(zip(*(floats(poses + (9 + part) * views, views) for part in range(3)), strict=True))
    for value, meaning in ((near, "near"), (far, "far")):
        cursor.fields.append(Field(start + 9, len(payload), value, f"inflated: {meaning}"))
    for view in range(views):
        for values, meaning in (
            (intrinsics[view], "fx fy cx cy"),
            (rotations[view], "rotation, row-major"),
            (centres[view], "camera centre"),
        ):
            cursor.fields.append(Field(start + 9, len(payload), values, f"inflated: view {view + 1}: {meaning}"))
    return near, far, intrinsics, rotations, centres


def inflate(start: int, payload: bytes, name: str, most: int) -> bytes:
    """Sections 6, 8.1 and 8.2, with the bounds of section 9, steps 5 and 6."""
    inflater = zlib.decompressobj(wbits=-15)
    try:
        content = inflater.decompress(payload, most + 1)
    except zlib.error as error:
        raise RefusedError(f"byte {start}: the {name} are no Deflate data ({error})") from error
    require(len(content) <= most, start, f"the {name} inflate to too much")
    require(inflater.eof and not inflater.unused_data, start, "the Deflate data does not end with the payload")
    return content


def read_rotation(words: list[int]) -> tuple[float, ...]:
    """Section 6.2."""
    r20, r21, r10 = (float_of_bits(word) for word in words[:3])
    r22 = add_difference(words[3], root(1 - r20 * r20 - r21 * r21))
    r00 = add_difference(words[4], root(1 - r20 * r20 - r10 * r10))
    r01 = add_difference(words[5], -ratio(r10 * r22 + (r00 * r20) * r21, r00 * r00 + r10 * r10))
    r11 = add_difference(words[6], ratio(r00 * r22 - (r10 * r20) * r21, r00 * r00 + r10 * r10))
    r02 = add_difference(words[7], r10 * r21 - r20 * r11)
    r12 = add_difference(words[8], r20 * r01 - r00 * r21)
    return r00, r01, r02, r10, r11, r12, r20, r21, r22


def add_difference(word: int, prediction: float) -> float:
    if math.isnan(prediction) or abs(prediction) > 1.5:
        prediction = 0.0
    bits: int = struct.unpack("<I", struct.pack("<f", prediction))[0]
    if bits == 0x80000000:
        bits = 0
    z = word // 2
    m = z // 2 if z % 2 == 0 else -(z + 1) // 2
    magnitude = (bits % 2**31 + m) % 2**31
    sign = bits // 2**31 ^ word % 2
    return float_of_bits(sign * 2**31 + magnitude)


def float_of_bits(bits: int) -> float:
    value: float = struct.unpack("<f", struct.pack("<I", bits))[0]
    return value


def root(x: float) -> float:
    return math.sqrt(x) if x > 0 else 0.0


def ratio(a: float, b: float) -> float:
    return a / b if b > 0 else 0.0


def check_cameras(start: int, near: float, far: float, intrinsics: Any, rotations: Any, centres: Any) -> None:
    """Section 6.3."""
    everything = [near, far, *(value for group in (*intrinsics, *rotations, *centres) for value in group)]
    require(all(math.isfinite(value) for value in everything), start, "a camera value is not finite")
    require(2**-40 <= near <= 2**40, start, "near is not 2^-40 to 2^40")
    require(near * (1 + 2**-9) <= far <= near * 2**14, start, "far is not 1 + 2^-9 to 2^14 times near")
    for r00, r01, r02, r10, r11, r12, r20, r21, r22 in rotations:
        rows = [(r00, r01, r02), (r10, r11, r12), (r20, r21, r22)]
        products = [p[0] * q[0] + p[1] * q[1] + p[2] * q[2] - (p is q) for p in rows for q in rows]
        orthonormal = max(abs(a) for row in rows for a in row) <= 2 and max(abs(a) for a in products) <= 0.001
        require(orthonormal, start, "a rotation is not orthonormal within 0.001")
        determinant = r00 * (r11 * r22 - r12 * r21) - r01 * (r10 * r22 - r12 * r20) + r02 * (r10 * r21 - r11 * r20)
        require(determinant >= 0, start, "a pose is mirrored")
    require(max(abs(value) for centre in centres for value in centre) <= 2**60, start, "a camera is too far away")
    for coordinates in zip(*centres, strict=True):
        mean = sum(coordinates) / len(coordinates)
        distance = max(abs(value - mean) for value in coordinates)
        require(distance <= 2**14 * near, start, "a camera is too far from the mean centre")
    for fx, fy, cx, cy in intrinsics:
        require(min(fx, fy) >= 2**-6 and max(fx, fy) <= 2**8, start, "a focal length is not 2^-6 to 2^8")
        require(max(abs(cx), abs(cy)) <= 2**8, start, "a principal point is above 2^8")


def read_coverage(cursor: Cursor, start: int, payload: bytes, header: dict[str, Any]) -> bytes:
    """Section 8.1: one bit for each cell of 4x4 pixels."""
    height, width = grid(header)
    return read_bits(cursor, start, payload, header["views"] * (height // 4) * (width // 4), "covered cells")


def read_fading(cursor: Cursor, start: int, payload: bytes, header: dict[str, Any]) -> bytes:
    """Section 8.2: two bits for each block of 16x16 pixels."""
    height, width = grid(header)
    return read_bits(cursor, start, payload, 2 * header["views"] * (height // 16) * (width // 16), "levels of fading")


def read_bits(cursor: Cursor, start: int, payload: bytes, num_bits: int, meaning: str) -> bytes:
    """Inflate and record a section of that many bits."""
    values = inflate(start, payload, meaning, num_bits // 8)
    require(len(values) == num_bits // 8, start, f"the {meaning} do not inflate to the right size")
    cursor.fields.append(Field(start + 9, len(payload), values, f"inflated: {meaning}"))
    return values


def grid(header: dict[str, Any]) -> tuple[int, int]:
    """Section 4: height and width of the coding grid."""
    return 32 * ((header["height"] + 16) // 32), 32 * ((header["width"] + 16) // 32)


def read_metadata(cursor: Cursor, start: int, payload: bytes) -> dict[str, Any]:
    """Section 8.3."""
    try:
        frame = zstandard.get_frame_parameters(payload)
        require(frame.content_size <= 65536, start, "metadata does not state its size")
        require(frame.window_size <= 2**23, start, "the window of the metadata's zstd frame is above 2^23")
        content = zstandard.ZstdDecompressor().decompress(payload, allow_extra_data=False)
        value = json.loads(content.decode("utf-8"), object_pairs_hook=unique_keys, parse_int=bounded_int)
        # Writing fails for strings that are not UTF-8 (unpaired surrogates) and for NaN and infinity, which JSON lacks.
        json.dumps(value, ensure_ascii=False, allow_nan=False).encode("utf-8")
    except (zstandard.ZstdError, ValueError, RecursionError) as error:
        raise RefusedError(f"byte {start}: the metadata cannot be read ({error})") from error
    require(isinstance(value, dict), start, "the metadata is no JSON object")
    require(depth(value) <= 8, start, "the metadata is nested more than 8 deep")
    cursor.fields.append(Field(start + 9, len(payload), value, "decompressed: metadata"))
    metadata: dict[str, Any] = value
    return metadata


def bounded_int(text: str) -> int:
    if not math.isfinite(float(text)):
        raise ValueError("a number is outside the range of binary64")
    return int(text)


def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len(dict(pairs)) != len(pairs):
        raise ValueError("a key appears twice")
    return dict(pairs)


def depth(value: Any) -> int:
    if not isinstance(value, dict | list):
        return 0
    return 1 + max(map(depth, value.values() if isinstance(value, dict) else value), default=0)


def read_detail(cursor: Cursor, start: int, payload: bytes) -> tuple[int, bytes]:
    """Section 8.4: the step, and the payload of symbols."""
    require(len(payload) > 0, start, "the detail is empty")
    require(payload[0] <= 63, start, "the step of the detail is above 63")
    cursor.fields.append(Field(start + 9, 1, payload[0], "inside: step of the detail: 1 stands for 2^(-step / 8)"))
    cursor.fields.append(Field(start + 10, len(payload) - 1, payload[1:], "inside: symbols of the detail"))
    return payload[0], payload[1:]


def show(value: Any) -> str:
    if isinstance(value, bytes):
        return value.hex(" ") if len(value) <= 16 else f"{value[:8].hex(' ')} ... {value[-4:].hex(' ')}"
    if isinstance(value, tuple):
        return " ".join(f"{part:.9g}" for part in value)
    return json.dumps(value)


def decode(contents: Contents, weights: bytes) -> list[Stage]:
    """Section 9, step 7: the symbols of every stage, after comparing their digests with those of the header."""
    header, size = contents.header, size_8(contents.header)
    check_model(header, weights)
    model = read_symbols.read_model(weights)
    stages: list[Stage] = []
    for number, payload in enumerate(contents.payloads, 1):
        before = stages[0].y_hat if stages else None
        lambda_q = header["lambda_q"] + (2 * header["excess"] if number == 1 else 0)
        try:
            stages.append(read_symbols.decode_stage(model, payload, size, lambda_q, number, before))
        except read_symbols.RefusedError as error:
            raise RefusedError(f"payload B{number}: {error}") from error
        require(stages[-1].digest == header["digests"][number - 1], 28, f"the digest of stage {number} does not hold")
    return stages


def decode_detail(contents: Contents, weights: bytes) -> list[list[int]]:
    """Section 9, step 8: the symbols of every plane of detail, in the order of its array."""
    if contents.detail is None:
        return []
    check_model(contents.header, weights)
    try:
        return read_symbols.decode_detail(weights, contents.detail[1], size_8(contents.header))
    except read_symbols.RefusedError as error:
        raise RefusedError(f"payload of detail: {error}") from error


def check_model(header: dict[str, Any], weights: bytes) -> None:
    needed, found = header["model_id"], hashlib.sha256(weights).digest()[:8]
    require(found == needed, 10, f"the stream needs the weights {needed.hex()}, these are {found.hex()}")


def size_8(header: dict[str, Any]) -> read_symbols.Size:
    """Return N, H8, W8."""
    height, width = grid(header)
    return header["views"], height // 8, width // 8


def print_fields(contents: Contents) -> None:
    for field in contents.fields:
        print(f"{field.address:08x} | {field.length:7} | {show(field.value)} | {field.meaning}")


def print_stages(contents: Contents, stages: list[Stage]) -> None:
    for number, stage in enumerate(stages, 1):
        symbols = [symbol for batch in stage.batches for symbol in batch]
        print(
            f"stage {number} | {len(symbols)} symbols, "
            f"{sum(symbol != 0 for symbol in symbols)} not zero, {min(symbols)} to {max(symbols)} | "
            f"digest {stage.digest.hex()}"
        )


def print_detail(planes: list[list[int]]) -> None:
    for number, symbols in enumerate(planes):
        print(
            f"plane {number} of detail | {len(symbols)} symbols, "
            f"{sum(symbol != 0 for symbol in symbols)} not zero, {min(symbols)} to {max(symbols)}"
        )


def main(arguments: list[str]) -> int:
    if len(arguments) not in (2, 3):
        print("usage: python read_stream.py FILE [WEIGHTS]", file=sys.stderr)
        return 1
    try:
        contents = read(Path(arguments[1]).read_bytes())
        stages, planes = list[Stage](), list[list[int]]()
        if len(arguments) == 3:
            weights = Path(arguments[2]).read_bytes()
            stages, planes = decode(contents, weights), decode_detail(contents, weights)
    except (OSError, RefusedError) as error:
        print(f"{arguments[1]}: {error}", file=sys.stderr)
        return 1
    print_fields(contents)
    print_stages(contents, stages)
    print_detail(planes)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
