"""The coverage section: which cells of the views show anything (FORMAT.md, section 8)."""

from fecocodec.container.deflate import BAD_WRITER, deflate, inflate
from fecocodec.container.header import Header
from fecocodec.errors import BitstreamError

CELL = 4  # pixels of the coding grid, each way


def coverage_grid(header: Header) -> tuple[int, int, int]:
    """Return the number of views, and of rows and columns of cells in a view."""
    height, width = header.grid_size
    return header.num_views, height // CELL, width // CELL


def pack_coverage(cells: bytes, header: Header) -> bytes:
    """Return the payload of the section; raises BitstreamError for cells of another size.

    cells: one bit a cell in the order view, row, column, the first in the highest bit of the first byte; 1: covered.
    """
    _check_size(cells, header, "section coverage")
    return deflate(cells)


def unpack_coverage(payload: bytes, header: Header, place: str) -> bytes:
    """Read the cells from the payload; raises BitstreamError, naming `place`, for each rule it breaks."""
    cells = inflate(payload, _num_bytes(header), place)
    _check_size(cells, header, place)
    return cells


def _num_bytes(header: Header) -> int:
    """Rows and columns are multiples of 8, so that the bits fill whole bytes."""
    views, rows, columns = coverage_grid(header)
    return views * rows * columns // 8


def _check_size(cells: bytes, header: Header, place: str) -> None:
    if len(cells) != _num_bytes(header):
        raise BitstreamError(
            f"{place}: its cells take {len(cells)} bytes, the views need {_num_bytes(header)}; {BAD_WRITER}"
        )
