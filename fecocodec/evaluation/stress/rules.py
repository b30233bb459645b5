"""What must hold for a stress case: a largest loss, a warning, a refusal, equal bytes."""

import re
from dataclasses import dataclass

from fecocodec.container import read_stream

MOST_BEHIND_DB = 0.5


@dataclass(frozen=True)
class Coded:
    """A coded trial. psnr: of the target views, in dB. warnings: what the sender says about its input and its file."""

    data: bytes
    psnr: float
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Rule:
    """Pass criterion of a stress case; an empty rule asks for finite values alone, as every rule does.

    most_lost: largest loss of PSNR against the reference, in dB; negative for cases that are easier. warning: regular
    expression of a warning that must come; with `most_lost`, if more is lost. is_refused: the sender raises InputError.
    has_same_bytes: the payloads equal those of the reference. most_behind: largest loss against JPEG XL at equal bytes,
    in dB; above MOST_BEHIND_DB for what docs/limits.md names.
    """

    most_lost: float | None = None
    warning: str = ""
    is_refused: bool = False
    has_same_bytes: bool = False
    most_behind: float = MOST_BEHIND_DB

    def __str__(self) -> str:
        if self.is_refused:
            return "refused"
        limit = "" if self.most_lost is None else f"≤{self.most_lost:g}"
        parts = filter(None, ("warned" * bool(self.warning), limit, "same bytes" * self.has_same_bytes))
        return (" or " if self.warning else ", ").join(parts) or "finite"

    def complaint(self, found: Coded, reference: Coded, ahead: float | None) -> str:
        """Return how the rule is violated, or an empty string. ahead: PSNR above that of JPEG XL at equal bytes, dB."""
        lost = reference.psnr - found.psnr
        if self.is_refused:
            return "it was not refused"
        is_warned = bool(self.warning) and any(re.search(self.warning, sentence) for sentence in found.warnings)
        if self.warning and self.most_lost is None and not is_warned:
            return f'no warning says "{self.warning}"'
        if self.has_same_bytes and read_stream(found.data).payloads != read_stream(reference.data).payloads:
            return "the payloads differ from those of the reference"
        if self.most_lost is not None and not lost <= self.most_lost and not is_warned:
            silently = " without a warning" if self.warning else ""
            return f"{lost:.2f} dB are lost{silently}, at most {self.most_lost:g} may be"
        if ahead is not None and ahead < -self.most_behind:
            return f"{-ahead:.2f} dB below JPEG XL at equal bytes, at most {self.most_behind:g} may be"
        return ""
