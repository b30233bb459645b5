"""Work of a batch that decodes: a `.fcs` file -> the bytes of a file of Gaussians. No torch where none is needed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from fecocodec.batch.scene_task import Result
from fecocodec.container import read_header, read_stream_file
from fecocodec.decoding import Decoded, decode
from fecocodec.errors import error_context
from fecocodec.splat_files.gaussian_files import decoded_file
from fecocodec.splat_files.output_formats import Frame, SpzVersion

Decode = Callable[[bytes], Decoded]
ON_ONE_THREAD: Decode = partial(decode, num_threads=1)


@dataclass(frozen=True)
class DecodeScene:
    """Decode each file and write its Gaussians.

    suffix: ending of the files, which selects the format. decode: `partial(fecocodec.decode, sh_degree=0)` and the
    like. decode_options: the options that change its result, for the sidecar. frame, sh_degree, spz_version: of the
    files, as for `decoded_file`.
    """

    suffix: str = ".ply"
    decode: Decode = ON_ONE_THREAD
    decode_options: tuple[tuple[str, Any], ...] = ()
    frame: Frame | None = None
    sh_degree: int | None = None
    spz_version: SpzVersion = 3

    def options(self) -> dict[str, Any]:
        """Return what changes the files, as JSON."""
        return {**dict(self.decode_options), **self._writing()}

    def _writing(self) -> dict[str, Any]:
        return {"frame": self.frame, "sh_degree": self.sh_degree, "spz_version": self.spz_version}

    def weights(self, path: Path) -> dict[str, str]:
        """Return the id of the model that the file needs. Raises FecoError if its header is not valid."""
        data = read_stream_file(path)
        with error_context(path):
            return {"model_id": read_header(data).header.model_id.hex()}

    def run(self, path: Path, name: str) -> Result:
        """Decode the file `path`; its page or error messages name `name`. Raises FecoError."""
        data = read_stream_file(path)
        with error_context(path):
            decoded = self.decode(data)
        written = decoded_file(decoded, Path(f"{name}{self.suffix}"), **self._writing())
        details: dict[str, Any] = {"gaussians": decoded.gaussians.count, "stages": decoded.stages}
        if written.note is not None:
            details["notes"] = [written.note]
        return Result(written.data, details=details)
