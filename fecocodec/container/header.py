"""The header of a `.fcs` stream: its fields and their limits (FORMAT.md, section 4)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from fecocodec.container.lagrangian import LAMBDA_MIN, LAMBDA_Q_MAX, STEPS_PER_E
from fecocodec.errors import BitstreamError
from fecocodec.limits import MAX_STAGES, MAX_VIEWS

MODEL_ID_BYTES = 8
DIGEST_BYTES = 8
MAX_SECTIONS = 16
MIN_SIDE, MAX_SIDE = 16, 4096
EXCESS_UNIT = 2  # of lambda_q: one byte reaches a factor of 7.3 in lambda
PADDING = 32  # the networks see sides rounded up to a multiple of this
MAX_PADDED_PIXELS = 1 << 24  # over all views: sixteen of 1024x1024


class FormatVersion(NamedTuple):
    """A reader refuses another major version and reads any minor version of its own."""

    major: int
    minor: int


CURRENT_VERSION = FormatVersion(1, 0)


@dataclass(frozen=True)
class Header:
    """What a reader must know before it reads a section.

    model_id: first 8 bytes of the SHA-256 of the receiver's weights. height, width: of every view, in pixels, before
    padding. lambda_q: see `quantise_lambda`; before a stage 2, stage 1 is coded at lambda_q + 2 first_stage_excess.
    symbol_digests: 8 bytes for each stage, over its decoded symbols.
    stage_2_views: the views that stage 2 codes, numbered from 0, ascending; the others keep what stage 1 gave them.
    Empty where there is only one stage.
    """

    model_id: bytes
    num_views: int
    height: int
    width: int
    lambda_q: int
    symbol_digests: tuple[bytes, ...]
    stage_2_views: tuple[int, ...]
    first_stage_excess: int = 0
    version: FormatVersion = CURRENT_VERSION

    @property
    def num_stages(self) -> int:
        return len(self.symbol_digests)

    def views_of_stage(self, stage: int) -> tuple[int, ...]:
        """The views that stage 1 or 2 codes, numbered from 0."""
        return tuple(range(self.num_views)) if stage == 1 else self.stage_2_views

    def lambda_q_of_stage(self, stage: int) -> int:
        """What the networks of stage 1 or 2 are conditioned on."""
        return self.lambda_q + EXCESS_UNIT * self.first_stage_excess if stage == 1 else self.lambda_q

    def lambda_of_stage(self, stage: int) -> float:
        """The price of a bit in stage 1 or 2; of stage 1 it may lie above the range that `encode` takes."""
        return LAMBDA_MIN * math.exp(self.lambda_q_of_stage(stage) / STEPS_PER_E)


def padded_pixels(num_views: int, height: int, width: int) -> int:
    """Pixels of all views after each side is rounded up to a multiple of 32: what the receiver's memory grows with."""
    return num_views * (-height % PADDING + height) * (-width % PADDING + width)


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
    pixels = padded_pixels(header.num_views, header.height, header.width)
    if pixels > MAX_PADDED_PIXELS:
        raise BitstreamError(
            f"header at byte 18: the views have {pixels} pixels after padding, "
            f"at most {MAX_PADDED_PIXELS} are allowed; encode fewer or smaller views."
        )
    _check_stage_2_views(header)
    _check_field_size(10, "model id", header.model_id, MODEL_ID_BYTES)
    for digest in header.symbol_digests:
        _check_field_size(30, "symbol digest", digest, DIGEST_BYTES)


def check_version(version: FormatVersion) -> None:
    """Raise BitstreamError for a major version other than ours or a minor version that does not fit its byte."""
    if version.major > CURRENT_VERSION.major:
        raise BitstreamError(
            f"header at byte 8: format version {version.major}.{version.minor} is newer than "
            f"{CURRENT_VERSION.major}.x, which this program reads; install a newer fecosplat."
        )
    if version.major < CURRENT_VERSION.major or not 0 <= version.minor <= 255:
        raise BitstreamError(
            f"header at byte 8: there is no format version {version.major}.{version.minor}; "
            "the file is damaged, copy or encode it again."
        )


def check_stages(num_stages: int) -> None:
    """Raise BitstreamError for a number of stages that the format does not have."""
    if not 1 <= num_stages <= MAX_STAGES:
        raise BitstreamError(
            f"header at byte 19: the number of stages is {num_stages}, allowed are 1 to {MAX_STAGES}; "
            "the file is damaged, copy or encode it again."
        )


def _check_stage_2_views(header: Header) -> None:
    views = header.stage_2_views
    if list(views) != [view for view in range(header.num_views) if view in views]:
        raise BitstreamError(
            f"header at byte 28: stage 2 codes the views {list(views)} of {header.num_views}, they must be distinct, "
            "ascending and among those there are; the program that wrote it is at fault, encode the scene again."
        )
    if (len(views) > 0) != (header.num_stages == 2):
        raise BitstreamError(
            f"header at byte 28: stage 2 codes {len(views)} views in a stream of {header.num_stages} stages, it must "
            "code some exactly if there is one; the program that wrote it is at fault, encode the scene again."
        )


def _check_field_size(offset: int, name: str, field: bytes, size: int) -> None:
    if len(field) != size:
        raise BitstreamError(f"header at byte {offset}: a {name} has {len(field)} bytes; give one of {size}.")
