"""Naming the file or folder in what goes wrong with it; the library was given its contents and does not know it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fecocodec.errors import BitstreamError, FecoError, InputError, ModelError

OF_STREAM = (BitstreamError, InputError, ModelError)
OF_VIEWS = (InputError,)


@contextmanager
def naming(path: Path, kinds: tuple[type[FecoError], ...] = OF_STREAM) -> Iterator[None]:
    """Put the name before an error of these kinds."""
    try:
        yield
    except kinds as error:
        raise type(error)(f"{path}: {error}") from error
