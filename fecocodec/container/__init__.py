"""The `.fcs` container: bytes to fields and back, without numpy or torch. The format is `bitstream_spec/FORMAT.md`."""

from fecocodec.container.cameras import PackedCameras
from fecocodec.container.detail_section import MAX_DETAIL_STEP, Detail
from fecocodec.container.header import EXCESS_UNIT, FormatVersion, Header
from fecocodec.container.header_bytes import read_header
from fecocodec.container.inspection import StreamSummary, inspect, list_sections
from fecocodec.container.lambda_quantisation import (
    LAMBDA_Q_MAX,
    dequantise_lambda,
    quantise_lambda,
)
from fecocodec.container.stage_choice import Stages, check_pixels, check_symbol_digest, decode_stages, read_stages
from fecocodec.container.stream import (
    IntactPart,
    Stream,
    read_intact,
    read_prefix,
    read_stream,
    with_metadata,
    write_stream,
)
from fecocodec.container.stream_file import read_stream_file
from fecocodec.container.view_grids import COVERAGE_CELLS, FADING_BLOCKS

__all__ = [
    "COVERAGE_CELLS",
    "EXCESS_UNIT",
    "FADING_BLOCKS",
    "LAMBDA_Q_MAX",
    "MAX_DETAIL_STEP",
    "Detail",
    "FormatVersion",
    "Header",
    "IntactPart",
    "PackedCameras",
    "Stages",
    "Stream",
    "StreamSummary",
    "check_pixels",
    "check_symbol_digest",
    "decode_stages",
    "dequantise_lambda",
    "inspect",
    "list_sections",
    "quantise_lambda",
    "read_header",
    "read_intact",
    "read_prefix",
    "read_stages",
    "read_stream",
    "read_stream_file",
    "with_metadata",
    "write_stream",
]
