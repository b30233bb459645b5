"""Targets of rate control: a file size or a quality instead of a lambda. Needs no torch."""

import math
from dataclasses import dataclass

from fecocodec.errors import InputError


@dataclass(frozen=True)
class AtMostKib:
    """Target: the best quality in a file of at most `kib` KiB."""

    kib: float

    def __post_init__(self) -> None:
        """Raise InputError for a size that no file can have."""
        _require_positive(self.kib, "KiB")


@dataclass(frozen=True)
class AtLeastPsnr:
    """Target: the smallest file whose decoded context views have at least this PSNR in dB."""

    psnr: float

    def __post_init__(self) -> None:
        """Raise InputError for a quality that no file can have."""
        _require_positive(self.psnr, "dB")


@dataclass(frozen=True)
class AtLeastNewPsnr(AtLeastPsnr):
    """Target: the smallest file with at least this PSNR in dB at new views, mean over photographs that are not coded.

    They choose lambda, and nothing else; what is measured on them is then fitted.
    """


Target = AtMostKib | AtLeastPsnr


def _require_positive(value: float, unit: str) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"a target of {value} {unit} cannot be reached; give a positive number.")
