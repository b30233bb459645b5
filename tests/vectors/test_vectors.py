"""Both readers decode the test streams to the symbols of `expected.json` and refuse the faulty ones."""

import hashlib
import json

import numpy as np
import pytest

from fecocodec.checkpoint import DEFAULT_MODEL, RECEIVER_FILE, SHIPPED
from fecocodec.container import read_stream
from fecocodec.errors import BitstreamError, ModelError
from tests.bitstream_spec.second_reader import SPECIFICATION
from tests.bitstream_spec.second_reader import read_stream as second_reader
from tests.vectors.make_vectors import changes_of, is_scene, make_all, newest_bits, why_not
from tests.vectors.symbols import check_detail, decode_detail_symbols, decode_symbols, weights_of
from tests.vectors.tiny_model import TINY_MODEL, VECTORS

EXPECTED = json.loads((VECTORS / "expected.json").read_text())
GOOD, FAULTY = EXPECTED["good"], EXPECTED["faulty"]
SCENES = [name for name in GOOD if is_scene(name)]


def read(name: str) -> bytes:
    return (VECTORS / name).read_bytes()


def test_no_vector_is_missing_and_none_is_unknown() -> None:
    streams = {path.relative_to(VECTORS).as_posix() for path in VECTORS.glob("*/*.fcs")}
    assert streams == GOOD.keys() | FAULTY.keys()
    by_folder = {folder: sum(name.startswith(folder) for name in streams) for folder in ("valid", "uncommon", "faulty")}
    assert by_folder["valid"] >= 12 and by_folder["uncommon"] >= 12 and by_folder["faulty"] >= 40
    assert f"valid/scene-{DEFAULT_MODEL}.fcs" in SCENES


@pytest.mark.parametrize("name", [name for name in GOOD if name not in SCENES or "nine" in name])
def test_the_second_reader_agrees_symbol_for_symbol(name: str) -> None:
    """Of the released scenes, which take long, it reads more in `test_second_receiver`, where it checks digests."""
    data = read(name)
    stream, contents = read_stream(data), second_reader.read(data)
    weights = weights_of(stream.header.model_id)
    ours, theirs = decode_symbols(stream), second_reader.decode(contents, weights)
    assert len(ours) == len(theirs)
    for mine, other in zip(ours, theirs, strict=True):
        assert [batch.ravel().tolist() for batch in mine.batches] == other.batches
        assert np.array_equal(mine.z_hat, np.array(other.z_hat).clip(-(1 << 24), 1 << 24))
        assert np.array_equal(mine.y_hat, np.array(other.y_hat).clip(-(1 << 24), 1 << 24))
    detail = decode_detail_symbols(stream)
    planes = [] if detail is None else [plane.ravel().tolist() for plane in detail]
    assert second_reader.decode_detail(contents, weights) == planes


@pytest.mark.parametrize("name", FAULTY)
def test_both_readers_refuse_a_faulty_stream(name: str) -> None:
    data, weights = read(name), TINY_MODEL.read_bytes()
    with pytest.raises((BitstreamError, ModelError)) as caught:
        stream = read_stream(data)
        decode_symbols(stream)
        check_detail(stream)
    assert FAULTY[name]["says"] in str(caught.value)
    with pytest.raises(second_reader.RefusedError):
        contents = second_reader.read(data)
        second_reader.decode(contents, weights)
        second_reader.decode_detail(contents, weights)


def test_every_rule_has_a_faulty_vector() -> None:
    """Rules are identified by the first column of the tables of FORMAT.md and ENTROPY.md."""
    format_rules = first_column((SPECIFICATION / "FORMAT.md").read_text(), "## 12. Errors", "## 13.")
    entropy_rules = first_column((SPECIFICATION / "ENTROPY.md").read_text(), "## 9. Errors", "## 10.")
    found = {entry["rule"] for entry in FAULTY.values()}
    about_weights = {"names, shapes, types and ranges of the model"}
    assert found == (format_rules | entropy_rules) - about_weights


def first_column(text: str, begin: str, end: str) -> set[str]:
    rows = [line for line in text.split(begin)[1].split(end)[0].splitlines() if line.startswith("| ")]
    return {row.split("|")[1].split(" (section")[0].strip() for row in rows[1:]}


def test_making_the_vectors_again_changes_nothing() -> None:
    """Recipes, model and files are consistent, and the product decodes what `expected.json` says.

    A change of the written bytes fails here.
    """
    made = make_all((VECTORS.parents[1] / "CHANGELOG.md").read_text())
    here = {path.relative_to(VECTORS).as_posix(): path.read_bytes() for path in VECTORS.rglob("*") if path.is_file()}
    here = {name: data for name, data in here.items() if not name.endswith((".safetensors", ".onnx"))}
    assert changes_of(made, here) == {}


@pytest.mark.parametrize("change", ["changed", "removed"])
def test_a_vector_is_not_changed_without_a_version_note(change: str) -> None:
    old, new = "- BITS: format 1.0\n", "- BITS: format 1.1\n- BITS: format 1.0\n"
    expected = {"bits": newest_bits(old), "good": GOOD, "faulty": FAULTY}
    refusal = why_not({"valid/one-stage.fcs": change}, old, expected)
    assert refusal is not None and f"valid/one-stage.fcs is {change}" in refusal and "CHANGELOG.md" in refusal
    assert why_not({"valid/one-stage.fcs": change}, new, expected) is None
    assert why_not({"valid/another.fcs": "new"}, old, expected) is None


def test_a_released_scene_is_not_changed_without_the_models_id_in_the_changelog() -> None:
    expected = {"bits": "", "good": GOOD, "faulty": FAULTY}
    model_id = hashlib.sha256((SHIPPED / DEFAULT_MODEL / RECEIVER_FILE).read_bytes()).hexdigest()[:16]
    refusal = why_not({f"valid/scene-{DEFAULT_MODEL}.fcs": "changed"}, "", expected)
    assert refusal is not None and model_id in refusal
    note = f"- BITS: weights {DEFAULT_MODEL}, model id {model_id}: better"
    assert why_not({f"valid/scene-{DEFAULT_MODEL}.fcs": "changed"}, note, expected) is None
