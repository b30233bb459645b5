"""Notes and warnings of one encoding."""

import re
from collections.abc import Callable
from pathlib import Path

from fecocodec.errors import InputError, StrictError, of_archive

OnMessage = Callable[[str], None]  # (sentence)


def of_input(path: Path, sentence: str) -> str:
    """Return a sentence about photographs as one about the frames of a video, if the input is one.

    Its path may be the first part of the sentence, and is kept.
    """
    from fecocodec.photographs.video_frames import is_video  # it loads numpy

    if not is_video(path):
        return sentence
    before, named, after = sentence.rpartition(str(path))
    return before + named + re.sub(r"\bphotograph(s?)\b", r"frame\1", after)


class Messages:
    """Passes each sentence on as soon as it is known, once, and keeps it.

    path: of the input, which is named in place of `folder`, to which an archive is unpacked. is_strict: raise
    StrictError for a warning instead.
    """

    def __init__(
        self,
        path: Path,
        is_strict: bool = False,
        on_note: OnMessage = lambda _sentence: None,
        on_warning: OnMessage = lambda _sentence: None,
    ) -> None:
        self.path, self.folder, self._is_strict = path, path, is_strict
        self._on_note, self._on_warning = on_note, on_warning
        self.notes: list[str] = []
        self.warnings: list[str] = []
        self.omitted: list[str] = []

    def note(self, *sentences: str) -> None:
        for sentence in map(self._told, sentences):
            if sentence not in self.notes:
                self.notes.append(sentence)
                self._on_note(sentence)

    def warn(self, *sentences: str) -> None:
        """Raises StrictError for the first warning if it is an error."""
        for sentence in map(self._told, sentences):
            if self._is_strict:
                warning = sentence.removesuffix(".")
                raise StrictError(f"{self.path}: {warning} (`strict` makes this warning an error).")
            if sentence not in self.warnings:
                self.warnings.append(sentence)
                self._on_warning(sentence)

    def omit(self, sentence: str, names: tuple[str, ...] = ()) -> None:
        """Warn of photographs that are left out: no error, as others take their place. names: kept in `omitted`."""
        self.omitted += names
        (self.note if self._is_strict else self.warn)(sentence)

    def _told(self, sentence: str) -> str:
        if self.folder != self.path:
            sentence = of_archive(sentence, self.folder, self.path)
        return of_input(self.path, sentence)

    def refuse(self, sentence: str) -> None:
        """Raise InputError."""
        raise InputError(f"{self.path}: {sentence}")
