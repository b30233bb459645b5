"""Check for the `cluster` extra, without importing any large library."""

from importlib.util import find_spec

from fecocodec.errors import InputError


def require_cluster_extra() -> None:
    """Raise InputError, which names the extra to install, if Dask distributed is missing."""
    if find_spec("distributed") is None:
        raise InputError(
            "several processes need the package distributed; pip install 'fecosplat[cluster]', or use one process with "
            "a `shard` such as 1/1."
        )
