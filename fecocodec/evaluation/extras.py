"""Libraries that only measuring needs: loaded when used, with a sentence where they are missing."""

from importlib import import_module
from types import ModuleType

from fecocodec.errors import InputError


def require_extra(library: str, purpose: str) -> ModuleType:
    """Import a library of the `eval` extra. Raises InputError, which says how to install it, where it is missing."""
    try:
        return import_module(library)
    except ImportError as error:
        raise InputError(
            f"{purpose} needs the package {library}, which is not installed; pip install 'fecosplat[eval]'."
        ) from error
