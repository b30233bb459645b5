"""The coverage section: one bit per cell, 0 where the photograph is transparent (FORMAT.md, section 8.1)."""

from fecocodec.container.deflate import BAD_WRITER, deflate, inflate
from fecocodec.container.header import Header
from fecocodec.errors import BitstreamError

CELL = 4  # side of a cell in pixels of the coding grid


def coverage_grid(header: Header) -> tuple[int, int, int]:
    """Return (views, rows, columns) of the cells."""
    height, width = header.grid_size
    return header.num_views, height // CELL, width // CELL


def pack_coverage(cells: bytes, header: Header) -> bytes:
    """Return the payload of the section. Raises BitstreamError if the size of `cells` does not match the header.

    cells: one bit per cell, 1 if covered, in the order (view, row, column), the highest bit of a byte first.
    """
    _check_size(cells, header, "section coverage")
    return deflate(cells)


def unpack_coverage(payload: bytes, header: Header, place: str) -> bytes:
    """Return the cells of a payload, as `pack_coverage` takes them.

    Raises BitstreamError, whose message starts with `place`, for an invalid payload.
    """
    cells = inflate(payload, _num_bytes(header), place)
    _check_size(cells, header, place)
    return cells


def _num_bytes(header: Header) -> int:
    """Return the number of bytes of the cells. Rows and columns are multiples of 8, so the bits fill whole bytes."""
    views, rows, columns = coverage_grid(header)
    return views * rows * columns // 8


def _check_size(cells: bytes, header: Header, place: str) -> None:
    if len(cells) != _num_bytes(header):
        raise BitstreamError(
            f"{place}: its cells take {len(cells)} bytes, the views need {_num_bytes(header)}; {BAD_WRITER}"
        )
