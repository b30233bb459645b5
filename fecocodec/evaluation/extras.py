"""Optional packages of the `eval` extra: imported on use, with a clear error if they are missing."""

from collections.abc import Iterable
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from fecocodec.errors import InputError, installation

_PACKAGES_OF_SYSTEMS = {"images": ("imagecodecs",), "gaussians": ("av", "gsply")}


def require_packages(systems: Iterable[str]) -> None:
    """Check, before any work, that the packages for these groups of systems are installed.

    Raises InputError that names the missing packages and the extra that installs them.
    """
    needed = {"flip_evaluator"}.union(*(_PACKAGES_OF_SYSTEMS.get(name, ()) for name in systems))
    if missing := sorted(name for name in needed if find_spec(name) is None):
        raise InputError(
            f"measuring needs packages that are not installed ({', '.join(missing)}); run {installation('eval')}."
        )


def require_extra(library: str, purpose: str) -> ModuleType:
    """Import a library of the `eval` extra. Raises InputError with installation instructions if it is missing."""
    try:
        return import_module(library)
    except ImportError as error:
        raise InputError(
            f"{purpose} needs the package {library}, which is not installed; run {installation('eval')}."
        ) from error
