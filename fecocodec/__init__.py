"""FeCoSplat: a feedback-guided feature codec for feed-forward 3D Gaussian splatting.

    views = fecocodec.read_views(Path("photos"))
    data = fecocodec.encode(views, lmbda=1e-3)
    decoded = fecocodec.decode(data)  # decoded.gaussians, decoded.cameras, ...

Public names are imported on first use, so that code without networks (`fecosplat info FILE`) does not import torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # `as` says that a name is public
    from fecocodec.captures.scene_folder import read_views as read_views
    from fecocodec.codec.encode_folder import EncodingReport as EncodingReport
    from fecocodec.codec.encode_folder import encode_folder as encode_folder
    from fecocodec.codec.options import EncodingOptions as EncodingOptions
    from fecocodec.decoding import Decoded as Decoded
    from fecocodec.decoding import decode as decode
    from fecocodec.errors import BitstreamError as BitstreamError
    from fecocodec.errors import FecoError as FecoError
    from fecocodec.errors import InputError as InputError
    from fecocodec.errors import ModelError as ModelError
    from fecocodec.errors import OutputError as OutputError
    from fecocodec.geometry.cameras import Cameras as Cameras
    from fecocodec.geometry.gaussians import Gaussians as Gaussians
    from fecocodec.geometry.views import Views as Views
    from fecocodec.rendering.rasterizer import Rendering as Rendering
    from fecocodec.rendering.rasterizer import render as render
    from fecocodec.sender.decoded_quality import measure_decoded as measure_decoded
    from fecocodec.sender.encode import encode as encode
    from fecocodec.sender.input_warnings import check_input as check_input
    from fecocodec.sender.lambda_search import AtLeastNewPsnr as AtLeastNewPsnr
    from fecocodec.sender.lambda_search import AtLeastPsnr as AtLeastPsnr
    from fecocodec.sender.lambda_search import AtMostKib as AtMostKib
    from fecocodec.sender.rate_control import encode_to_target as encode_to_target
    from fecocodec.sender.view_quality import DecodedQuality as DecodedQuality
    from fecocodec.sender.view_quality import quality_warnings as quality_warnings
    from fecocodec.splat_files.ply import read_ply as read_ply
    from fecocodec.splat_files.ply_writing import write_ply as write_ply

__version__ = "0.1.0"

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
__all__ = ["__version__", *_MODULE_OF]


def __getattr__(name: str) -> object:
    """Import a public name on first access (PEP 562)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'fecocodec' has no attribute {name!r}")
    value: object = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
