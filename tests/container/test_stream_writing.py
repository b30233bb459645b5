"""Writing an invalid stream raises an error."""

from dataclasses import replace
from typing import Any

import pytest

from fecocodec.container import Detail, PackedCameras, Stream, write_stream
from fecocodec.errors import BitstreamError
from tests.container.example_streams import example_cameras, example_stream

GOOD = example_stream()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"num_views": 3}, "header: 3 views, but 2 cameras"),
        ({"height": 8}, "the height is 8"),
        ({"lambda_q": -1}, "the quantised lambda is -1"),
        ({"model_id": b"short"}, "a model id has 5 bytes"),
        ({"symbol_digests": (b"digest 1",)}, "header: 1 stages, but 2 payloads"),
        ({"symbol_digests": (b"digest 1", b"2")}, "a symbol digest has 1 bytes"),
    ],
)
def test_a_header_that_does_not_fit_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(BitstreamError, match=message):
        write_stream(replace(GOOD, header=replace(GOOD.header, **change)))


@pytest.mark.parametrize(
    ("cameras", "message"),
    [
        (replace(example_cameras(), near=0.1), "near is 0.1, it must be a finite float32 value"),
        (replace(example_cameras(), far=1e39), "far is 1e\\+39, it must be a finite float32 value"),
        (replace(example_cameras(), intrinsics=((1.0, 1.0, 0.5, 0.5),)), "2 extrinsics and 1 intrinsics"),
        (replace(example_cameras(), extrinsics=((1.0,) * 11,) * 2), "it has 11 and 4 values"),
    ],
)
def test_cameras_that_do_not_fit_are_refused(cameras: PackedCameras, message: str) -> None:
    with pytest.raises(BitstreamError, match=f"section cameras: .*{message}"):
        write_stream(replace(GOOD, cameras=cameras))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"coverage": bytes(1791)}, "section coverage: its cells take 1791 bytes, the views need 1792"),
        ({"fading": bytes(225)}, "section fading: its blocks take 225 bytes, the views need 224"),
        ({"detail": Detail(-1, b"")}, "section detail: its step is -1, allowed are 0 to 63; "),
        ({"detail": Detail(64, b"")}, "section detail: its step is 64, allowed are 0 to 63; "),
    ],
)
def test_sections_that_do_not_fit_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(BitstreamError, match=message):
        write_stream(replace(GOOD, **change))


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"a": float("nan")}, "cannot be written as JSON"),
        ({"a": b"bytes"}, "cannot be written as JSON"),
        ({"a": "\ud800"}, "cannot be written as JSON"),
        ({"a": {1: "number as key"}}, "JSON cannot hold it exactly"),
        ({"a": (1, 2)}, "JSON cannot hold it exactly"),
        ({"a": "x" * 70_000}, "its JSON has 70008 bytes, at most 65536"),
    ],
)
def test_metadata_that_json_cannot_hold_is_refused(metadata: dict[Any, Any], message: str) -> None:
    with pytest.raises(BitstreamError, match=f"section metadata: .*{message}"):
        write_stream(Stream(GOOD.header, GOOD.cameras, GOOD.payloads, metadata))
