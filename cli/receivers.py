"""The receiver that `fecosplat decode` uses: onnxruntime, or torch for what needs it."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from fecocodec import model_files
from fecocodec.container import Stages

from .options import num_threads

if TYPE_CHECKING:
    from fecocodec import Decoded
    from fecocodec.runtime.decode import DecodedScene

OnProgress = Callable[[str, float], None]


@dataclass(frozen=True)
class DecodeOptions:
    """Options of `fecosplat decode` that change the Gaussians or the way in which they are computed."""

    stages: Stages
    sh_degree: int
    has_background: bool
    merges: bool
    device: str
    model: Path | None
    max_pixels: int


def decode_stream(data: bytes, options: DecodeOptions, on_progress: OnProgress) -> "Decoded | DecodedScene":
    """Decode a stream; errors are those of the library's receivers.

    Torch decodes on other devices than the CPU, and models without graphs if it is installed.
    """
    if options.device != "cpu" or (not _has_graphs(options.model) and find_spec("torch") is not None):
        return _decode_with_torch(data, options, on_progress)
    from fecocodec.merging.merge import MergingConfig
    from fecocodec.runtime.decode import decode

    return decode(
        data,
        stages=options.stages,
        sh_degree=options.sh_degree,
        has_background=options.has_background,
        merging=MergingConfig() if options.merges else None,
        num_threads=num_threads(0),
        model=options.model,
        max_pixels=options.max_pixels,
        on_progress=on_progress,
    )


def _decode_with_torch(data: bytes, options: DecodeOptions, on_progress: OnProgress) -> "Decoded":
    from fecocodec import decode
    from fecocodec.layers.memory_format import usable_device
    from fecocodec.splatting.background import DEFAULT_BACKGROUND
    from fecocodec.splatting.merging import MergingConfig

    usable_device(options.device)
    return decode(
        data,
        stages=options.stages,
        sh_degree=options.sh_degree,
        background=DEFAULT_BACKGROUND if options.has_background else None,
        merging=MergingConfig() if options.merges else None,
        device=options.device,
        model=options.model,
        max_pixels=options.max_pixels,
        on_progress=on_progress,
    )


def _has_graphs(model: Path | None) -> bool:
    """Return whether a model's folder (None: one of the shipped ones) has the graphs of a whole receiver."""
    folders = [model] if model is not None else list(model_files.SHIPPED.iterdir())
    names = ("attributes.onnx", "hide.onnx")  # the last ones of an export
    return any(all((folder / model_files.GRAPHS_FOLDER / name).is_file() for name in names) for folder in folders)
