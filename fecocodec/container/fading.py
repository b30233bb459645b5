"""The fading section: two bits per block, how much the opacities of its Gaussians are reduced (FORMAT.md, 8.2)."""

from fecocodec.container.deflate import BAD_WRITER, deflate, inflate
from fecocodec.container.header import Header
from fecocodec.errors import BitstreamError

FADING_BLOCK = 16  # side of a block in pixels of the coding grid
NUM_LEVELS = 4  # level s multiplies opacities by 1 - s / 3


def fading_grid(header: Header) -> tuple[int, int, int]:
    """Return (views, rows, columns) of the blocks."""
    height, width = header.grid_size
    return header.num_views, height // FADING_BLOCK, width // FADING_BLOCK


def pack_fading(levels: bytes, header: Header) -> bytes:
    """Return the payload of the section. Raises BitstreamError if the size of `levels` does not match the header.

    levels: two bits per block, in the order (view, row, column), the highest bits of a byte first.
    """
    _check_size(levels, header, "section fading")
    return deflate(levels)


def unpack_fading(payload: bytes, header: Header, place: str) -> bytes:
    """Return the levels of a payload, as `pack_fading` takes them.

    Raises BitstreamError, whose message starts with `place`, for an invalid payload.
    """
    levels = inflate(payload, _num_bytes(header), place)
    _check_size(levels, header, place)
    return levels


def _num_bytes(header: Header) -> int:
    """Return the number of bytes of the levels. Rows and columns are multiples of 2, so they fill whole bytes."""
    views, rows, columns = fading_grid(header)
    return views * rows * columns // 4


def _check_size(levels: bytes, header: Header, place: str) -> None:
    if len(levels) != _num_bytes(header):
        raise BitstreamError(
            f"{place}: its blocks take {len(levels)} bytes, the views need {_num_bytes(header)}; {BAD_WRITER}"
        )
