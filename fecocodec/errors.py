"""Exceptions of the library. Each message is one sentence with file, location, cause and remedy."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import inf

BAD_WRITER = "the program that wrote it is at fault, encode the scene again."  # ends messages about streams


class FecoError(Exception):
    """Base class of all errors of this library; the message is meant for the end user."""


class InputError(FecoError):
    """Views, cameras or options are not valid."""


class OptionError(InputError):
    """Options exclude each other, or are for another kind of input; the command line calls it wrong usage."""


class SizeError(InputError):
    """A file cannot be as small as was asked. kib: the smallest size, in KiB."""

    def __init__(self, message: str, kib: float = inf) -> None:
        super().__init__(message)
        self.kib = kib


class BitstreamError(FecoError):
    """The bytes are not a valid `.fcs` stream, or not one that this version supports."""


class ModelError(FecoError):
    """Weights are missing, damaged or not those that a stream needs."""


class OutputError(FecoError):
    """A result cannot be written."""


class StrictError(FecoError):
    """A warning that the option `strict` makes an error."""


def installation(extra: str) -> str:
    """Return how an extra is installed. Not by the project's name, because it is not on a package index."""
    return f"`pip install '.[{extra}]'` in the project's folder"


def some_of(names: Sequence[object], most: int = 3) -> str:
    """Return the first names and the number of the others: `a, b, c and 2 more`."""
    return ", ".join(map(str, names[:most])) + (f" and {len(names) - most} more" if len(names) > most else "")


def one_sentence(sentences: Sequence[str]) -> str:
    """Return sentences as one, with semicolons."""
    return "; ".join(sentence.removesuffix(".") for sentence in sentences) + "."


def of_archive(sentence: str, folder: object, archive: object) -> str:
    """Return a sentence about a folder as one about the archive that was unpacked to it."""
    inside = re.escape(f"{folder}/")
    return re.sub(rf"\bgive (?=[^;]*{inside})", "unpack it and give ", sentence).replace(str(folder), str(archive))


@contextmanager
def error_context(
    place: object, kinds: tuple[type[FecoError], ...] = (BitstreamError, InputError, ModelError)
) -> Iterator[None]:
    """Prefix the message of every error of these kinds that the block raises with `place`, the file or folder read.

    Code that receives the contents of a file does not know its name.
    """
    try:
        yield
    except kinds as error:
        named = type(error)(f"{place}: {error}")
        vars(named).update(vars(error))
        raise named from error
