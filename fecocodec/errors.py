"""Exceptions of the library. Each message is one sentence with file, location, cause and remedy."""


class FecoError(Exception):
    """Base class of all errors of this library; the message is meant for the end user."""


class InputError(FecoError):
    """Views, cameras or options are not valid."""


class BitstreamError(FecoError):
    """The bytes are not a valid `.fcs` stream, or not one that this version supports."""


class ModelError(FecoError):
    """Weights are missing, damaged or not those that a stream needs."""


class OutputError(FecoError):
    """A result cannot be written."""


class StrictError(FecoError):
    """A warning that the option `strict` makes an error, see `strict_error`."""


def installation(extra: str) -> str:
    """Return how an extra is installed. Not by the project's name, because it is not on a package index."""
    return f"`pip install '.[{extra}]'` in the project's folder"


def strict_error(place: str, warning: str) -> StrictError:
    """Return the error for a warning, which is one sentence. place: file or folder that it is about."""
    return StrictError(f"{place}: {warning.removesuffix('.')} (`strict` makes this warning an error).")
