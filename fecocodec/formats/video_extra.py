"""Check for the `video` extra, without importing any large library."""

from importlib.util import find_spec

from fecocodec.errors import OutputError


def require_video_extra() -> None:
    """Raise OutputError, which names the extra to install, if PyAV is missing."""
    if find_spec("av") is None:
        raise OutputError("writing a video needs the package av; pip install 'fecosplat[video]'.")
