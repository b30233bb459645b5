"""The header of a `.fcs` stream: its fields and their limits (FORMAT.md, section 4)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from fecocodec.container.lagrangian import LAMBDA_MIN, LAMBDA_Q_MAX, STEPS_PER_E
from fecocodec.errors import BitstreamError
from fecocodec.limits import MAX_SIDE, MAX_STAGES, MAX_VIEWS, MIN_SIDE, grid_side

MODEL_ID_BYTES = 8
DIGEST_BYTES = 8
MAX_SECTIONS = 16
EXCESS_UNIT = 2  # of lambda_q: one byte reaches a factor of 7.3 in lambda


class FormatVersion(NamedTuple):
    """A reader refuses another major version and reads any minor version of its own."""

    major: int
    minor: int


CURRENT_VERSION = FormatVersion(2, 0)


@dataclass(frozen=True)
class Header:
    """What a reader must know before it reads a section.

    model_id: first 8 bytes of the SHA-256 of the receiver's weights. height, width: of every view, in pixels.
    lambda_q: see `quantise_lambda`; before a stage 2, stage 1 is coded at lambda_q + 2 first_stage_excess.
    symbol_digests: 8 bytes for each stage, over its decoded symbols.
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
        """(height, width) of the coding grid in pixels."""
        return grid_side(self.height), grid_side(self.width)

    @property
    def num_pixels(self) -> int:
        """Pixels of the coding grids of all views: what memory and time of decoding are proportional to."""
        height, width = self.grid_size
        return self.num_views * height * width

    def lambda_q_of_stage(self, stage: int) -> int:
        """What the networks of stage 1 or 2 are conditioned on."""
        return self.lambda_q + EXCESS_UNIT * self.first_stage_excess if stage == 1 else self.lambda_q

    def lambda_of_stage(self, stage: int) -> float:
        """The price of a bit in stage 1 or 2; of stage 1 it may lie above the range that `encode` takes."""
        return LAMBDA_MIN * math.exp(self.lambda_q_of_stage(stage) / STEPS_PER_E)


def check_header(header: Header, num_sections: int) -> None:
    """Raise BitstreamError for the first field outside its limits; offsets are those of the header's bytes."""
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
    """Raise BitstreamError for a major version other than ours or a minor version that does not fit its byte."""
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
    """Raise BitstreamError for a number of stages that the format does not have."""
    if not 1 <= num_stages <= MAX_STAGES:
        raise BitstreamError(
            f"header at byte 19: the number of stages is {num_stages}, allowed are 1 to {MAX_STAGES}; "
            "the file is damaged, copy or encode it again."
        )


def _check_field_size(offset: int, name: str, field: bytes, size: int) -> None:
    if len(field) != size:
        raise BitstreamError(f"header at byte {offset}: a {name} has {len(field)} bytes; give one of {size}.")
