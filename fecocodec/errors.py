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
