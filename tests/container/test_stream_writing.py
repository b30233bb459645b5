"""Writing an invalid stream raises an error."""

from dataclasses import replace
from typing import Any

import pytest

from fecocodec.container import Detail, Stream, write_stream
from fecocodec.errors import BitstreamError
from tests.container.example_streams import example_cameras, example_stream

GOOD, CAMERAS = example_stream(), example_cameras()


def with_header(**fields: Any) -> Stream:
    return replace(GOOD, header=replace(GOOD.header, **fields))


def with_cameras(**fields: Any) -> Stream:
    return replace(GOOD, cameras=replace(CAMERAS, **fields))


@pytest.mark.parametrize(
    ("stream", "message"),
    [
        (with_header(num_views=3), "header: 3 views, but 2 cameras"),
        (with_header(height=8), "the height is 8"),
        (with_header(lambda_q=-1), "the quantised lambda is -1"),
        (with_header(model_id=b"short"), "a model id has 5 bytes"),
        (with_header(symbol_digests=(b"digest 1",)), "header: 1 stages, but 2 payloads"),
        (with_header(symbol_digests=(b"digest 1", b"2")), "a symbol digest has 1 bytes"),
        (with_cameras(near=0.1), "section cameras: .*near is 0.1, it must be a finite float32 value"),
        (with_cameras(far=1e39), "section cameras: .*far is 1e\\+39, it must be a finite float32 value"),
        (with_cameras(intrinsics=CAMERAS.intrinsics[:1]), "section cameras: .*2 extrinsics and 1 intrinsics"),
        (with_cameras(extrinsics=((1.0,) * 11,) * 2), "section cameras: .*it has 11 and 4 values"),
        (replace(GOOD, coverage=bytes(1791)), "section coverage: its cells take 1791 bytes, the views need 1792"),
        (replace(GOOD, fading=bytes(225)), "section fading: its blocks take 225 bytes, the views need 224"),
        (replace(GOOD, detail=Detail(-1, b"")), "section detail: its step is -1, allowed are 0 to 63; "),
        (replace(GOOD, detail=Detail(64, b"")), "section detail: its step is 64, allowed are 0 to 63; "),
        (replace(GOOD, metadata={"a": float("nan")}), "section metadata: .*cannot be written as JSON"),
        (replace(GOOD, metadata={"a": b"bytes"}), "section metadata: .*cannot be written as JSON"),
        (replace(GOOD, metadata={"a": "\ud800"}), "section metadata: .*cannot be written as JSON"),
        (replace(GOOD, metadata={"a": {1: "number as key"}}), "section metadata: .*JSON cannot hold it exactly"),
        (replace(GOOD, metadata={"a": (1, 2)}), "section metadata: .*JSON cannot hold it exactly"),
        (replace(GOOD, metadata={"a": "x" * 70_000}), "section metadata: .*its JSON has 70008 bytes, at most 65536"),
    ],
)
def test_a_stream_that_breaks_a_rule_is_not_written(stream: Stream, message: str) -> None:
    with pytest.raises(BitstreamError, match=message):
        write_stream(stream)
