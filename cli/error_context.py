"""Error context: prefix library errors with the file or folder that was read.

The library receives the contents of a file, not its path, so it cannot name the file in its messages.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fecocodec.errors import BitstreamError, FecoError, InputError, ModelError

OF_STREAM = (BitstreamError, InputError, ModelError)
OF_VIEWS = (InputError,)


@contextmanager
def error_context(path: Path, kinds: tuple[type[FecoError], ...] = OF_STREAM) -> Iterator[None]:
    """Prefix the message of every error of these kinds that the block raises with `path`."""
    try:
        yield
    except kinds as error:
        raise type(error)(f"{path}: {error}") from error
