"""Entropy coding of detail (ENTROPY.md, section 7.2). It needs no network and no torch."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float32, Int32, Integer, UInt8

from fecocodec.container import Detail, Header
from fecocodec.entropy.symbol_coders import SymbolCoder, SymbolReader, SymbolWriter
from fecocodec.entropy.tables import NUM_TABLES
from fecocodec.errors import BitstreamError, ModelError
from fecocodec.grid import LATENTS

LARGEST_COUNTED = 15  # magnitude of a symbol from which on larger ones change no context
THRESHOLDS = (1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 96, 140)  # lowest contexts of the buckets 1 to 15
_BUCKET_OF = np.searchsorted(THRESHOLDS, np.arange(THRESHOLDS[-1] + 1), side="right")  # of each context up to the last

Size = tuple[int, int, int]
"""Views, rows and columns of a plane: blocks of 8x8 pixels of the coding grid."""

Choose = Callable[[int, UInt8[np.ndarray, "view h8 w8"]], Int32[np.ndarray, "view h8 w8"]]
"""(plane, table index of each element) -> the symbols to write."""


def table_indices(
    tables: UInt8[np.ndarray, "plane 16"], plane: int, earlier: Int32[np.ndarray, "view h8 w8"]
) -> UInt8[np.ndarray, "view h8 w8"]:
    """Return the index of the frequency table of each symbol of a plane.

    tables: of the model, by plane and bucket of the context. earlier: sum of `magnitudes` over the planes before.
    """
    return tables[plane][_buckets(earlier)]


def buckets(symbols: Int32[np.ndarray, "plane view h8 w8"]) -> Integer[np.ndarray, "plane view h8 w8"]:
    """Return the bucket, 0 to 15, of the context of each symbol."""
    earlier = np.cumsum(magnitudes(symbols), axis=0) - magnitudes(symbols)
    return np.stack([_buckets(of_plane) for of_plane in earlier])


def _buckets(earlier: Integer[np.ndarray, "view h8 w8"]) -> Integer[np.ndarray, "view h8 w8"]:
    padded = np.pad(earlier, ((0, 0), (1, 1), (1, 1)))
    context = 2 * earlier + padded[:, :-2, 1:-1] + padded[:, 2:, 1:-1] + padded[:, 1:-1, :-2] + padded[:, 1:-1, 2:]
    found: np.ndarray = _BUCKET_OF[np.minimum(context, THRESHOLDS[-1])]
    return found


def magnitudes(symbols: Int32[np.ndarray, "*shape"]) -> Int32[np.ndarray, "*shape"]:
    """Return what symbols add to the contexts of later planes."""
    return np.minimum(np.abs(symbols), LARGEST_COUNTED)


def code_detail(
    coder: SymbolCoder, tables: UInt8[np.ndarray, "plane 16"], size: Size, choose: Choose | None
) -> Int32[np.ndarray, "plane view h8 w8"]:
    """Code all planes with a symbol writer or reader; returns the symbols that a receiver decodes.

    choose: for a writer, called for plane after plane; None for a reader. Chosen symbols are clamped to +-2^20; those
    of elements that are not coded are replaced by 0. Raises BitstreamError if a reader decodes an impossible value,
    ModelError for tables that do not exist.
    """
    if int(tables.max()) >= NUM_TABLES:
        raise ModelError(
            f"weights: detail.tables names table {tables.max()} of {NUM_TABLES}, counted from 0; reinstall the package."
        )
    symbols = np.zeros((len(tables), *size), np.int32)
    earlier = np.zeros(size, np.int32)
    for plane in range(len(tables)):
        indices = table_indices(tables, plane, earlier)
        symbols[plane] = coder.exchange(indices, None if choose is None else choose(plane, indices))
        earlier += magnitudes(symbols[plane])
    return symbols


def encode_detail(
    tables: UInt8[np.ndarray, "plane 16"], choose: Choose, size: Size
) -> tuple[bytes, Int32[np.ndarray, "plane view h8 w8"]]:
    """Return the payload, and the symbols that a receiver decodes from it. Arguments as for `code_detail`."""
    writer = SymbolWriter()
    symbols = code_detail(writer, tables, size, choose)
    return writer.finish(), symbols


def decode_detail(
    tables: UInt8[np.ndarray, "plane 16"], payload: bytes, size: Size
) -> Int32[np.ndarray, "plane view h8 w8"]:
    """Return the symbols of a payload. Raises BitstreamError for a payload that is not valid."""
    reader = SymbolReader(payload)
    symbols = code_detail(reader, tables, size, None)
    reader.finish()
    return symbols


def detail_size(header: Header) -> Size:
    """Return the size of the planes of a stream."""
    height, width = header.grid_size
    return header.num_views, height // LATENTS, width // LATENTS


def detail_values(
    tables: UInt8[np.ndarray, "plane 16"] | None, detail: Detail, header: Header
) -> Float32[np.ndarray, "view plane h8 w8"]:
    """Return the values of a stream's detail: symbols times the step of quantisation (FORMAT.md, section 9.1).

    tables: of the model; None if it has no detail. Raises BitstreamError if it has none or the payload is not valid.
    """
    if tables is None:
        raise BitstreamError(
            f"section detail: the model {header.model_id.hex()} has no detail; the program that wrote the file is at "
            "fault, encode the scene again."
        )
    try:
        symbols = decode_detail(tables, detail.payload, detail_size(header))
    except BitstreamError as error:
        raise BitstreamError(f"section detail: {error}") from error
    return symbols.swapaxes(0, 1).astype(np.float32, order="C") * step_size(detail.step)


def step_size(step: int) -> np.float32:
    """Return the step of quantisation, 2^(-step / 8), rounded to float32. step: `Detail.step`."""
    return np.float32(2.0 ** (-step / 8))
