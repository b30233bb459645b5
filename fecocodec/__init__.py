"""FeCoSplat: a feedback-guided feature codec for feed-forward 3D Gaussian splatting.

    views = fecocodec.read_views(Path("photos"))
    data = fecocodec.encode(views, lmbda=1e-3)
    decoded = fecocodec.decode(data)  # decoded.gaussians, decoded.cameras, ...

Public names are imported on first use, so that code without networks (`fecosplat info FILE`) does not import torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fecocodec.captures.scene_folder import read_views
    from fecocodec.codec.encode_folder import EncodingReport, encode_folder
    from fecocodec.codec.options import EncodingOptions
    from fecocodec.decoding import Decoded, decode
    from fecocodec.errors import BitstreamError, FecoError, InputError, ModelError, OutputError
    from fecocodec.geometry.cameras import Cameras
    from fecocodec.geometry.gaussians import Gaussians
    from fecocodec.geometry.views import Views
    from fecocodec.rendering.rasterizer import Rendering, render
    from fecocodec.sender.decoded_quality import measure_decoded
    from fecocodec.sender.encode import encode
    from fecocodec.sender.input_warnings import check_input
    from fecocodec.sender.lambda_search import AtLeastNewPsnr, AtLeastPsnr, AtMostKib
    from fecocodec.sender.rate_control import encode_to_target
    from fecocodec.sender.view_quality import DecodedQuality, quality_warnings
    from fecocodec.splat_files.ply import read_ply
    from fecocodec.splat_files.ply_writing import write_ply

__version__ = "0.1.0"

__all__ = [
    "AtLeastNewPsnr",
    "AtLeastPsnr",
    "AtMostKib",
    "BitstreamError",
    "Cameras",
    "Decoded",
    "DecodedQuality",
    "EncodingOptions",
    "EncodingReport",
    "FecoError",
    "Gaussians",
    "InputError",
    "ModelError",
    "OutputError",
    "Rendering",
    "Views",
    "__version__",
    "check_input",
    "decode",
    "encode",
    "encode_folder",
    "encode_to_target",
    "measure_decoded",
    "quality_warnings",
    "read_ply",
    "read_views",
    "render",
    "write_ply",
]

_NAMES_IN = {
    "fecocodec.captures.scene_folder": "read_views",
    "fecocodec.codec.encode_folder": "EncodingReport encode_folder",
    "fecocodec.codec.options": "EncodingOptions",
    "fecocodec.decoding": "Decoded decode",
    "fecocodec.errors": "BitstreamError FecoError InputError ModelError OutputError",
    "fecocodec.geometry.cameras": "Cameras",
    "fecocodec.geometry.gaussians": "Gaussians",
    "fecocodec.geometry.views": "Views",
    "fecocodec.rendering.rasterizer": "Rendering render",
    "fecocodec.sender.decoded_quality": "measure_decoded",
    "fecocodec.sender.encode": "encode",
    "fecocodec.sender.input_warnings": "check_input",
    "fecocodec.sender.lambda_search": "AtLeastNewPsnr AtLeastPsnr AtMostKib",
    "fecocodec.sender.rate_control": "encode_to_target",
    "fecocodec.sender.view_quality": "DecodedQuality quality_warnings",
    "fecocodec.splat_files.ply": "read_ply",
    "fecocodec.splat_files.ply_writing": "write_ply",
}
_MODULE_OF = {name: module for module, names in _NAMES_IN.items() for name in names.split()}


def __getattr__(name: str) -> object:
    """Import a public name on first access (PEP 562)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'fecocodec' has no attribute {name!r}")
    value: object = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
