"""Check for the `cluster` extra, without importing any large library."""

from importlib.util import find_spec

from fecocodec.errors import InputError, installation


def has_cluster_extra() -> bool:
    """Return whether Dask distributed is installed."""
    return find_spec("distributed") is not None


def require_cluster_extra() -> None:
    """Raise InputError, which names the extra to install, if Dask distributed is missing."""
    if not has_cluster_extra():
        raise InputError(
            f"several processes need the package distributed; run {installation('cluster')}, or use one process by "
            "`workers=1`."
        )
