"""Notes and warnings of one encoding."""

from collections.abc import Callable
from pathlib import Path

from fecocodec.errors import InputError, strict_error

OnMessage = Callable[[str], None]  # (sentence)


class Messages:
    """Passes each sentence on as soon as it is known, and keeps it.

    path: of the input. is_strict: raise StrictError for a warning instead.
    """

    def __init__(self, path: Path, is_strict: bool, on_note: OnMessage, on_warning: OnMessage) -> None:
        self.path, self._is_strict = path, is_strict
        self._on_note, self._on_warning = on_note, on_warning
        self.notes: list[str] = []
        self.warnings: list[str] = []
        self.omitted: list[str] = []

    def note(self, *sentences: str) -> None:
        for sentence in sentences:
            self.notes.append(sentence)
            self._on_note(sentence)

    def warn(self, *sentences: str) -> None:
        """Raises StrictError for the first warning if it is an error."""
        for sentence in sentences:
            if self._is_strict:
                raise strict_error(str(self.path), sentence)
            self.warnings.append(sentence)
            self._on_warning(sentence)

    def omit(self, sentence: str, names: tuple[str, ...] = ()) -> None:
        """Warn of photographs that are left out: no error, as others take their place. names: kept in `omitted`."""
        self.omitted += names
        (self.note if self._is_strict else self.warn)(sentence)

    def refuse(self, sentence: str) -> None:
        """Raise InputError."""
        raise InputError(f"{self.path}: {sentence}")
