"""The keep section: which Gaussians a receiver emits; without it, all that can be seen (FORMAT.md, section 8.1)."""

from dataclasses import dataclass

from fecocodec.container.deflate import BAD_WRITER, deflate, inflate
from fecocodec.container.header import Header
from fecocodec.errors import BitstreamError

CELL = 8  # pixels a side
MAX_THRESHOLD = 255


@dataclass(frozen=True)
class Keep:
    """Gaussians that the sender found to be of use.

    opacity_threshold: in 255ths; a Gaussian of opacity below it is not emitted (0 and 1 change nothing: renderers skip
    what is below 1/255). cells: one bit for each cell of 8x8 pixels, ordered (view, row, column), the first in the
    highest bit of the first byte; the Gaussians of a cell whose bit is 0 are not emitted. None: no cell is left out.
    """

    opacity_threshold: int
    cells: bytes | None = None

    @property
    def num_kept_cells(self) -> int | None:
        """How many bits of `cells` are 1, None where there are none."""
        return None if self.cells is None else int.from_bytes(self.cells).bit_count()


def cell_grid(header: Header) -> tuple[int, int, int]:
    """Views, rows and columns of cells; those at the lower and right border may be cut by it."""
    return header.num_views, -(-header.height // CELL), -(-header.width // CELL)


def num_cells(header: Header) -> int:
    """The number of bits in `Keep.cells`."""
    views, rows, columns = cell_grid(header)
    return views * rows * columns


def pack_keep(keep: Keep, header: Header) -> bytes:
    """The payload of the keep section; raises BitstreamError for what it cannot hold."""
    place = "section keep"
    if not 0 <= keep.opacity_threshold <= MAX_THRESHOLD:
        raise BitstreamError(
            f"{place}: the opacity threshold is {keep.opacity_threshold}, give one from 0 to {MAX_THRESHOLD}."
        )
    if keep.cells is None:
        return bytes([keep.opacity_threshold])
    _check_cells(keep.cells, header, place)
    return bytes([keep.opacity_threshold]) + deflate(keep.cells)


def unpack_keep(payload: bytes, header: Header, place: str) -> Keep:
    """Read the payload of the keep section; raises BitstreamError, naming `place`, for each rule it breaks."""
    if not payload:
        raise BitstreamError(f"{place}: it is empty, it must begin with an opacity threshold; {BAD_WRITER}")
    if len(payload) == 1:
        return Keep(payload[0])
    cells = inflate(payload[1:], _num_bytes(header), place)
    _check_cells(cells, header, place)
    return Keep(payload[0], cells)


def _num_bytes(header: Header) -> int:
    return -(-num_cells(header) // 8)


def _check_cells(cells: bytes, header: Header, place: str) -> None:
    if len(cells) != _num_bytes(header):
        raise BitstreamError(
            f"{place}: its cells take {len(cells)} bytes, {num_cells(header)} cells need {_num_bytes(header)}; "
            f"{BAD_WRITER}"
        )
    num_spare_bits = -num_cells(header) % 8
    if cells[-1] & (1 << num_spare_bits) - 1:
        raise BitstreamError(f"{place}: a bit after the last cell's is not 0; {BAD_WRITER}")
