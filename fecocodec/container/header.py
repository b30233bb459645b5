"""The header of a `.fcs` stream: its fields and their limits (FORMAT.md, section 4)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from fecocodec.container.lambda_quantisation import LAMBDA_MIN, LAMBDA_Q_MAX, STEPS_PER_E
from fecocodec.errors import BitstreamError
from fecocodec.grid import grid_side
from fecocodec.limits import MAX_SIDE, MAX_STAGES, MAX_VIEWS, MIN_SIDE
from fecocodec.model_files import MODEL_ID_BYTES

DIGEST_BYTES = 8
MAX_SECTIONS = 16
EXCESS_UNIT = 2  # in steps of lambda_q: the largest offset, 255 units, is a factor of 7.3 in lambda


class FormatVersion(NamedTuple):
    """Version of the format. A reader refuses other major versions and reads every minor version of its own major."""

    major: int
    minor: int


CURRENT_VERSION = FormatVersion(2, 0)


@dataclass(frozen=True)
class Header:
    """Fields of the header of a stream.

    model_id: first 8 bytes of the SHA-256 of the receiver's weights. height, width: of every view, in pixels.
    lambda_q: quantised lambda, see `quantise_lambda`. symbol_digests: 8-byte digest of the decoded symbols, per stage.
    first_stage_excess: stage-1 lambda offset; stage 1 is coded at lambda_q + 2 first_stage_excess. It is 0 in a stream
    of one stage.
    """

    model_id: bytes
    num_views: int
    height: int
    width: int
    lambda_q: int
    symbol_digests: tuple[bytes, ...]
    first_stage_excess: int = 0
    version: FormatVersion = CURRENT_VERSION

    @property
    def num_stages(self) -> int:
        return len(self.symbol_digests)

    @property
    def grid_size(self) -> tuple[int, int]:
        """Return (height, width) of the coding grid in pixels."""
        return grid_side(self.height), grid_side(self.width)

    @property
    def num_pixels(self) -> int:
        """Return the pixels of the coding grids of all views, to which decoding time and memory are proportional."""
        height, width = self.grid_size
        return self.num_views * height * width

    def lambda_q_of_stage(self, stage: int) -> int:
        """Return the quantised lambda on which the networks of stage 1 or 2 are conditioned."""
        return self.lambda_q + EXCESS_UNIT * self.first_stage_excess if stage == 1 else self.lambda_q

    def lambda_of_stage(self, stage: int) -> float:
        """Return lambda of stage 1 or 2. That of stage 1 can exceed the range that `encode` accepts."""
        return LAMBDA_MIN * math.exp(self.lambda_q_of_stage(stage) / STEPS_PER_E)


def check_header(header: Header, num_sections: int) -> None:
    """Raise BitstreamError for the first field outside its limits; the message states the field's byte offset."""
    check_version(header.version)
    check_stages(header.num_stages)
    for offset, name, value, lowest, highest in (
        (18, "number of views", header.num_views, 1, MAX_VIEWS),
        (20, "height", header.height, MIN_SIDE, MAX_SIDE),
        (22, "width", header.width, MIN_SIDE, MAX_SIDE),
        (24, "quantised lambda", header.lambda_q, 0, LAMBDA_Q_MAX),
        (26, "number of sections", num_sections, 1 + header.num_stages, MAX_SECTIONS),
        (27, "excess of stage 1", header.first_stage_excess, 0, 0 if header.num_stages == 1 else 255),
    ):
        if not lowest <= value <= highest:
            raise BitstreamError(
                f"header at byte {offset}: the {name} is {value}, allowed are {lowest} to {highest}; "
                "encode the scene again within these limits."
            )
    _check_field_size(10, "model id", header.model_id, MODEL_ID_BYTES)
    for digest in header.symbol_digests:
        _check_field_size(28, "symbol digest", digest, DIGEST_BYTES)


def check_version(version: FormatVersion) -> None:
    """Raise BitstreamError for another major version, or a minor version that does not fit in a byte."""
    if version.major > CURRENT_VERSION.major:
        raise BitstreamError(
            f"header at byte 8: format version {version.major}.{version.minor} is newer than "
            f"{CURRENT_VERSION.major}.x, which this program reads; install a newer fecosplat."
        )
    if version.major < CURRENT_VERSION.major or not 0 <= version.minor <= 255:
        raise BitstreamError(
            f"header at byte 8: format version {version.major}.{version.minor} was never released, this program reads "
            f"{CURRENT_VERSION.major}.x; encode the photographs again."
        )


def check_stages(num_stages: int) -> None:
    """Raise BitstreamError unless the number of stages is 1 or 2."""
    if not 1 <= num_stages <= MAX_STAGES:
        raise BitstreamError(
            f"header at byte 19: the number of stages is {num_stages}, allowed are 1 to {MAX_STAGES}; "
            "the file is damaged, copy or encode it again."
        )


def _check_field_size(offset: int, name: str, field: bytes, size: int) -> None:
    if len(field) != size:
        raise BitstreamError(f"header at byte {offset}: a {name} has {len(field)} bytes; give one of {size}.")
