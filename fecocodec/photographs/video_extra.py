"""Check for the `video` extra, without importing any large library."""

from importlib.util import find_spec

from fecocodec.errors import OutputError, installation


def require_video_extra() -> None:
    """Raise OutputError, which names the extra to install, if PyAV is missing."""
    if find_spec("av") is None:
        raise OutputError(f"writing a video needs the package av; run {installation('video')}.")
