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
    from fecocodec.splat_files.ply import read_ply, write_ply

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

_MODULE_OF = {
    "AtLeastNewPsnr": "fecocodec.sender.lambda_search",
    "AtLeastPsnr": "fecocodec.sender.lambda_search",
    "AtMostKib": "fecocodec.sender.lambda_search",
    "BitstreamError": "fecocodec.errors",
    "Cameras": "fecocodec.geometry.cameras",
    "Decoded": "fecocodec.decoding",
    "DecodedQuality": "fecocodec.sender.view_quality",
    "EncodingOptions": "fecocodec.codec.options",
    "EncodingReport": "fecocodec.codec.encode_folder",
    "FecoError": "fecocodec.errors",
    "Gaussians": "fecocodec.geometry.gaussians",
    "InputError": "fecocodec.errors",
    "ModelError": "fecocodec.errors",
    "OutputError": "fecocodec.errors",
    "Rendering": "fecocodec.rendering.rasterizer",
    "Views": "fecocodec.geometry.views",
    "check_input": "fecocodec.sender.input_warnings",
    "decode": "fecocodec.decoding",
    "encode": "fecocodec.sender.encode",
    "encode_folder": "fecocodec.codec.encode_folder",
    "encode_to_target": "fecocodec.sender.rate_control",
    "measure_decoded": "fecocodec.sender.decoded_quality",
    "quality_warnings": "fecocodec.sender.view_quality",
    "read_ply": "fecocodec.splat_files.ply",
    "read_views": "fecocodec.captures.scene_folder",
    "render": "fecocodec.rendering.rasterizer",
    "write_ply": "fecocodec.splat_files.ply",
}


def __getattr__(name: str) -> object:
    """Import a public name on first access (PEP 562)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'fecocodec' has no attribute {name!r}")
    value: object = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
