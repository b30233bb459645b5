"""Every error the library raises on purpose: one sentence with file, place, cause and remedy."""


class FecoError(Exception):
    """Base of all errors of this library; its text is written for the person who sees it."""


class InputError(FecoError):
    """Views, cameras or options that cannot be used."""


class BitstreamError(FecoError):
    """Bytes that are not a valid `.fcs` stream, or not one this version reads."""


class ModelError(FecoError):
    """Weights that are missing, damaged or not the ones a stream needs."""


class OutputError(FecoError):
    """A result that could not be written."""
