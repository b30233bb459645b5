"""The reader written from FORMAT.md alone agrees with the product, on good and on faulty streams."""

import ast
import hashlib
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fecocodec.container import Detail, PackedCameras, Stream, read_stream, write_stream
from fecocodec.errors import BitstreamError
from fecocodec.model_files import GRAPHS_FOLDER, RECEIVER_FILE, SHIPPED, model_id_of
from tests.bitstream_spec.second_reader import READER, RECEIVER, SPECIFICATION, SYMBOL_READER
from tests.bitstream_spec.second_reader import read_stream as second_reader
from tests.container.example_streams import CAMERAS, COVERAGE, FADING, METADATA, streams
from tests.container.faulty_streams import EXAMPLE, GOOD, deflated

read_stream_again, RefusedError = second_reader.read, second_reader.RefusedError

# The type checks of the tests pick an element to look at with `random`, also while a strategy builds a stream.
pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module inside strategies")

INSIDE_PAYLOADS = ("inflated", "decompressed", "inside")


def assert_same_contents(data: bytes) -> None:
    ours, theirs = read_stream(data), read_stream_again(data)
    header = ours.header
    assert theirs.header == {
        "major": header.version.major,
        "minor": header.version.minor,
        "model_id": header.model_id,
        "views": header.num_views,
        "stages": header.num_stages,
        "height": header.height,
        "width": header.width,
        "lambda_q": header.lambda_q,
        "excess": header.first_stage_excess,
        "sections": theirs.header["sections"],
        "digests": list(header.symbol_digests),
    }
    poses = tuple(
        r[0:3] + c[0:1] + r[3:6] + c[1:2] + r[6:9] + c[2:3]
        for r, c in zip(theirs.rotations, theirs.centres, strict=True)
    )
    assert ours.cameras == PackedCameras(poses, tuple(theirs.intrinsics), theirs.near, theirs.far)
    assert ours.payloads == tuple(theirs.payloads)
    assert ours.coverage == theirs.coverage
    assert ours.fading == theirs.fading
    assert (None if ours.detail is None else (ours.detail.step, ours.detail.payload)) == theirs.detail
    assert ours.metadata == theirs.metadata


@settings(max_examples=40)
@given(streams())
def test_both_readers_see_the_same_stream_and_the_fields_cover_every_byte_once(stream: Stream) -> None:
    data = write_stream(stream)
    assert_same_contents(data)
    fields = [field for field in read_stream_again(data).fields if not field.meaning.startswith(INSIDE_PAYLOADS)]
    end = 0
    for field in fields:
        assert field.address == end
        end += field.length
    assert end == len(data)


@pytest.mark.parametrize(("kind", "limit", "size"), [(COVERAGE, 2**18, 1792), (FADING, 2**15, 224)])
def test_both_readers_limit_payloads_that_inflate_to_the_right_size(kind: int, limit: int, size: int) -> None:
    """Deflate data may begin with empty blocks of five bytes, so only the limit forbids the longer payload."""
    content, empty_block = deflated(bytes(size)), b"\0\0\0\xff\xff"
    blocks = (limit - len(content)) // len(empty_block)
    most, too_much = (EXAMPLE.with_section(kind, count * empty_block + content) for count in (blocks, blocks + 1))
    assert_same_contents(most)
    with pytest.raises(BitstreamError, match=f"at most {limit}"):
        read_stream(too_much)
    with pytest.raises(RefusedError):
        read_stream_again(too_much)


@given(st.data())
def test_both_readers_judge_bent_content_alike(data: st.DataObject) -> None:
    """Camera and metadata payloads with changed bytes under a CRC that holds."""
    kind, original = data.draw(st.sampled_from([(CAMERAS, EXAMPLE.cameras[9:]), (METADATA, EXAMPLE.metadata[9:])]))
    payload = bytearray(original)
    for position in data.draw(st.lists(st.integers(0, len(payload) - 1), min_size=1, max_size=3)):
        payload[position] = data.draw(st.integers(0, 255))
    bent = EXAMPLE.with_section(kind, bytes(payload))
    try:
        read_stream(bent)
    except BitstreamError:
        with pytest.raises(RefusedError):
            read_stream_again(bent)
    else:
        assert_same_contents(bent)


def part(begin: str, end: str) -> str:
    """The text between two headings of FORMAT.md."""
    return (SPECIFICATION / "FORMAT.md").read_text().split(begin)[1].split(end)[0]


def hex_dump(begin: str, end: str) -> bytes:
    """The bytes that are shown between two headings."""
    return bytes.fromhex("".join(re.findall(r"^0[0-9a-f]{2}0  (.+)$", part(begin, end), re.MULTILINE)))


def worked_example() -> bytes:
    return hex_dump("### 13.1", "### 13.2")


def test_the_steps_of_the_worked_example_hold() -> None:
    """Its bytes are those of the smallest vector, and its numbers are found again by the second reader."""
    data = hex_dump("### 13.2", "## 14.")
    assert data == (SPECIFICATION / "vectors" / "uncommon" / "smallest.fcs").read_bytes()
    shown = dict(re.findall(r"^\| (.+?) \| ([-0-9, ]+)", part("### 13.2", "## 14."), re.MULTILINE))
    weights = (SPECIFICATION / "vectors" / "tiny.safetensors").read_bytes()
    first, _ = second_reader.decode(read_stream_again(data), weights)
    assert numbers(shown["symbols of z"]) == first.batches[0]
    assert numbers(shown["z_hat at row 0, column 0"]) == first.z_hat[0][0][0]
    assert numbers(shown["symbols of y, first pass"]) == first.batches[1]
    assert numbers(shown["y_hat at row 0, column 0"]) == first.y_hat[0][0][0]


def numbers(text: str) -> list[int]:
    return [int(number) for number in re.findall(r"-?\d+", text)]


def test_the_worked_example_is_a_stream_and_says_what_the_text_says() -> None:
    data = worked_example()
    assert_same_contents(data)
    stream = read_stream(data)
    assert (stream.header.num_views, stream.header.height, stream.header.width) == (1, 64, 96)
    assert stream.payloads == (bytes.fromhex("de ad be ef"),)
    assert stream.cameras.intrinsics == ((1.25, 1.875, 0.5, 0.5),)
    assert (stream.cameras.near, stream.cameras.far) == (1.0, 100.0)
    assert stream.cameras.extrinsics[0][3::4] == (1.0, 2.0, 3.0)
    assert [round(value, 8) for value in stream.cameras.extrinsics[0][8:11]] == [-0.47942555, 0.2171174, 0.85030067]


def test_the_program_prints_every_field(tmp_path: Path) -> None:
    file = tmp_path / "scene.fcs"
    file.write_bytes(worked_example())
    result = subprocess.run([sys.executable, "-E", "-s", READER, file], capture_output=True, text=True, check=True)
    lines = result.stdout.splitlines()
    assert lines[0] == "00000000 |       8 | 89 46 43 53 0d 0a 1a 0a | signature"
    assert "00000067 |       4 | de ad be ef | B1: payload" in lines
    assert all(re.fullmatch(r"[0-9a-f]{8} \| +\d+ \| .+ \| .+", line) for line in lines)


@pytest.mark.parametrize("content", [b"", GOOD[:100], b"not a stream at all"])
def test_the_program_refuses_with_one_sentence(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "scene.fcs"
    file.write_bytes(content)
    result = subprocess.run([sys.executable, "-E", "-s", READER, file], capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr.startswith(f"{file}: byte ")
    assert result.stderr.count("\n") == 1


def weights_with(name: str, shape: tuple[int, ...], values: bytes, dtype: str = "U8") -> bytes:
    """Return a weights file (ENTROPY.md, section 6.1) of one tensor."""
    entry = {"dtype": dtype, "shape": shape, "data_offsets": (2, 2 + len(values))}
    header = json.dumps({"__metadata__": {}, name: entry}).encode()
    return len(header).to_bytes(8, "little") + header + b"\0\0" + values


def stream_with_detail(weights: bytes, payload: bytes) -> bytes:
    header = replace(EXAMPLE.stream.header, model_id=hashlib.sha256(weights).digest()[:8], height=64, width=96)
    return write_stream(replace(EXAMPLE.stream, header=header, detail=Detail(5, payload)))


@pytest.mark.parametrize(
    ("weights", "payload", "message"),
    [
        (weights_with("prior.enter.bias", (16,), bytes(64), "I32"), b"", "the model has no detail"),
        (weights_with("detail.tables", (4, 8), bytes(32)), b"", "the tables of detail are not 16 for each plane"),
        (weights_with("detail.tables", (2, 16), bytes([64] * 32)), b"", "a weight is out of range"),
        (weights_with("detail.tables", (2, 16), bytes(64), "I16"), b"", "a tensor has a wrong form"),
        (weights_with("detail.tables", (2, 16), bytes(32)), b"\1\0\0\0", "symbols and bytes do not end together"),
        (weights_with("detail.tables", (2, 16), bytes(32)), b"\1\0\0", "the payload is no list of words"),
    ],
)
def test_the_second_reader_refuses_detail_that_it_cannot_decode(weights: bytes, payload: bytes, message: str) -> None:
    contents = read_stream_again(stream_with_detail(weights, payload))
    with pytest.raises(RefusedError, match=f"payload of detail: {message}"):
        second_reader.decode_detail(contents, weights)


def test_the_second_reader_decodes_no_detail_with_other_weights() -> None:
    weights = weights_with("detail.tables", (2, 16), bytes(32))
    contents = read_stream_again(stream_with_detail(weights, b""))
    step = (5, "inside: step of the detail: 1 stands for 2^(-step / 8)")
    assert step in [(field.value, field.meaning) for field in contents.fields]
    assert second_reader.decode_detail(contents, weights) == [[0] * 192] * 2
    with pytest.raises(RefusedError, match="the stream needs the weights"):
        second_reader.decode_detail(contents, weights + b"!")


FOREIGN_TO_US = {"zstandard", "read_symbols", "read_stream", "numpy", "onnxruntime"}


@pytest.mark.parametrize("file", [READER, SYMBOL_READER, RECEIVER], ids=lambda file: file.stem)
def test_the_second_reader_shares_no_code_with_the_product(file: Path) -> None:
    imported = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            imported |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add((node.module or "").partition(".")[0])
    assert imported - FOREIGN_TO_US <= sys.stdlib_module_names


MODELS = sorted(path.parent.parent.name for path in SHIPPED.glob(f"*/{GRAPHS_FOLDER}/update.onnx"))


def listed(model: str) -> tuple[str, dict[str, str]]:
    """Return the model id and the SHA-256 of each graph, as FORMAT.md has them."""
    pattern = rf"Graphs of `{model}`, model id `(\w+)`.*?\n\n(.+?)\n\n"
    model_id, table = re.search(pattern, part("### 9.3 ", "## 10. "), re.DOTALL).groups()  # type: ignore[union-attr]
    return model_id, dict(re.findall(r"^\| `(\w+)` \|.*\| `(\w{64})` \|$", table, re.MULTILINE))


@pytest.mark.parametrize("model", MODELS)
def test_the_graphs_of_a_model_are_those_of_the_specification(model: str) -> None:
    """After `make graphs`, their hashes are copied to FORMAT.md, section 9.3."""
    graphs = (SHIPPED / model / GRAPHS_FOLDER).glob("*.onnx")
    found = {path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in graphs}
    assert listed(model) == (model_id_of((SHIPPED / model / RECEIVER_FILE).read_bytes()).hex(), found)


def test_every_model_is_found() -> None:
    assert "compact-6" in MODELS
