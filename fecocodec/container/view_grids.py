"""The sections coverage and fading: a few bits for each square of the views (FORMAT.md, sections 8.1 and 8.2)."""

from dataclasses import dataclass

from fecocodec.container.deflate import deflate, inflate
from fecocodec.container.header import Header
from fecocodec.errors import BAD_WRITER, BitstreamError
from fecocodec.grid import FADING, FEATURES


@dataclass(frozen=True)
class ViewGrids:
    """Squares of the coding grids of all views, with a value for each.

    name: of the section. squares: what they are called in messages. side: of a square, in pixels. bits: of a value.
    Values are in the order (view, row, column), the first in the highest bits of a byte.
    """

    name: str
    squares: str
    side: int
    bits: int

    def shape(self, header: Header) -> tuple[int, int, int]:
        """Return (views, rows, columns) of the squares."""
        height, width = header.grid_size
        return header.num_views, height // self.side, width // self.side

    def pack(self, values: bytes, header: Header) -> bytes:
        """Return the payload of the section. Raises BitstreamError for a wrong size of `values`."""
        self._check_size(values, header, f"section {self.name}")
        return deflate(values)

    def unpack(self, payload: bytes, header: Header, place: str) -> bytes:
        """Return the values of a payload. Raises BitstreamError, which starts with `place`, for an invalid payload."""
        values = inflate(payload, self._num_bytes(header), place)
        self._check_size(values, header, place)
        return values

    def _num_bytes(self, header: Header) -> int:
        """Return the number of bytes of all values. They fill whole bytes, because sides are multiples of 32 pixels."""
        views, rows, columns = self.shape(header)
        return views * rows * columns * self.bits // 8

    def _check_size(self, values: bytes, header: Header, place: str) -> None:
        if len(values) != self._num_bytes(header):
            raise BitstreamError(
                f"{place}: its {self.squares} take {len(values)} bytes, "
                f"the views need {self._num_bytes(header)}; {BAD_WRITER}"
            )


COVERAGE_CELLS = ViewGrids("coverage", "cells", side=FEATURES, bits=1)  # 1: Gaussians of the cell are kept
FADING_BLOCKS = ViewGrids("fading", "blocks", side=FADING, bits=2)  # level s: opacities are multiplied by 1 - s / 3
