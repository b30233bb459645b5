"""Baseline that transmits the Gaussians' attributes as images, by HEVC (PyAV, libx265); the idea is TinySplat's.

Each attribute is a plane of grey frames of 12 bits, one frame a view; the receiver needs no network. A smaller gain of
a plane makes its quantisation coarser. Gains were found by coordinate descent on four training pairs.
"""

from fractions import Fraction
from functools import partial
from time import perf_counter

import numpy as np
import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, UInt16
from torch import Tensor

from fecocodec.coding.camera_packing import unpack
from fecocodec.container.cameras import pack_cameras, unpack_cameras
from fecocodec.evaluation.extras import require_extra
from fecocodec.evaluation.systems.codec import rendered
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.evaluation.systems.uncoded import DECODED, Uncoded, uncoded
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.geometry.views import Views
from fecocodec.layers.blocks import pixel_shuffle
from fecocodec.receiver.decode import emitted_gaussians
from fecocodec.receiver.model import Receiver
from fecocodec.sender.codec import Codec
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.splatting.attributes import LARGEST_DISPARITY_STEP, LARGEST_LOG_SCALE, RAW, activate
from fecocodec.splatting.emission import Prediction

NAME = "Gaussians as HEVC"
QPS = (14, 20, 26, 32, 38)
LEVELS = 4095
FORMAT = "gray12le"
# Of disparity, opacity, offset (2), scale (3), rotation (3) and colour (3).
GAINS = (1.0, 0.25, *(0.0625,) * 2, *(0.125,) * 6, *(0.25,) * 3)
DISPARITY_MARGIN = 0.05 + LARGEST_DISPARITY_STEP  # by which relative disparity leaves [0, 1] at most
YCBCR = ((0.299, 0.587, 0.114), (-0.168736, -0.331264, 0.5), (0.5, -0.418688, -0.081312))  # of ITU-R BT.601
Maps = Float[Tensor, "view plane h2 w2"]


def gaussian_map_systems(codec: Codec) -> tuple[System, ...]:
    """Return one system per QP, with the default latent optimisation."""
    return tuple(System(NAME, f"QP {qp}", partial(_reconstruct, codec, qp)) for qp in QPS)


def _reconstruct(codec: Codec, qp: int, views: Views, num_context: int) -> Reconstruction:
    begin = perf_counter()
    scene = uncoded(codec, views.select(list(range(num_context))), DEFAULT)
    files = encode_maps(maps_of(codec.receiver, scene), qp), pack_cameras(scene.packed)
    encoded = perf_counter()
    cameras = unpack(unpack_cameras(files[1], num_context, NAME))
    prediction = prediction_of(decode_maps(files[0], num_context), normalise_scene(cameras)[0].as_batch())
    gaussians = emitted_gaussians(prediction, cameras, codec.receiver.config, scene.emission(DECODED))
    decoded = perf_counter()
    return rendered(gaussians, views, sum(map(len, files)), encoded - begin, decoded - encoded)


@torch.no_grad()
def maps_of(receiver: Receiver, scene: Uncoded) -> Maps:
    """Return the attributes of the Gaussians in [0, 1], in the order of GAINS."""
    cameras = normalise_scene(unpack(scene.packed))[0].as_batch()
    predictor = receiver.predictor
    features, attended, relative = predictor.before_head(scene.state.state, cameras, scene.state.condition)
    raw = pixel_shuffle(predictor.head(features + attended).float(), receiver.config.gaussians_per_side)
    opacity, offset, step, scale, rotation, colour = raw.split([*RAW.values()], dim=1)
    fine = F.interpolate(relative, raw.shape[-2:], mode="bilinear", align_corners=False)[0][:, None]
    disparity = fine + LARGEST_DISPARITY_STEP * torch.tanh(step)
    quaternion = F.normalize(rotation + raw.new_tensor((1.0, 0.0, 0.0, 0.0))[:, None, None], dim=1)
    quaternion = torch.where(quaternion[:, :1] < 0, -1.0, 1.0) * quaternion
    ycbcr = torch.einsum("ij,vjhw->vihw", raw.new_tensor(YCBCR), torch.sigmoid(2.0 * colour))
    centred = (torch.tanh(offset), torch.tanh(scale / LARGEST_LOG_SCALE), quaternion[:, 1:])
    maps = (
        (disparity + DISPARITY_MARGIN) / (1.0 + 2.0 * DISPARITY_MARGIN),
        torch.sigmoid(opacity + 2.0),
        *(0.5 + 0.5 * values for values in centred),
        ycbcr[:, :1],
        0.5 + ycbcr[:, 1:],
    )
    return torch.cat(maps, dim=1).clamp(0.0, 1.0)


def prediction_of(maps: Maps, cameras: Cameras) -> Prediction:
    """Return the prediction whose attributes have these maps. cameras: normalised, with one batch dimension."""
    disparity, opacity, offset, scale, rotation, ycbcr = maps.split((1, 1, 2, 3, 3, 3), dim=1)
    relative = (disparity * (1.0 + 2.0 * DISPARITY_MARGIN) - DISPARITY_MARGIN)[None, :, 0]
    offset, scale, rotation = (2.0 * values - 1.0 for values in (offset, scale, rotation))
    real = (1.0 - rotation.square().sum(dim=1, keepdim=True)).clamp_min(0.0).sqrt()
    centred = torch.cat((ycbcr[:, :1], ycbcr[:, 1:] - 0.5), dim=1)
    colour = torch.einsum("ij,vjhw->vihw", torch.linalg.inv(maps.new_tensor(YCBCR)), centred)
    raw = (
        torch.logit(opacity, 1e-4) - 2.0,
        torch.atanh(offset.clamp(-0.9999, 0.9999)),
        torch.zeros_like(disparity),
        LARGEST_LOG_SCALE * torch.atanh(scale.clamp(-0.9999, 0.9999)),
        real - 1.0,
        rotation,
        0.5 * torch.logit(colour, 1e-4),
    )
    return Prediction(activate(rearrange(torch.cat(raw, dim=1), "v c h w -> 1 v h w c"), relative, cameras), relative)


def encode_maps(maps: Maps, qp: int) -> bytes:
    """Return an HEVC stream of all planes, view by view within each. Raises InputError if PyAV is not installed."""
    av = require_extra("av", f"coding {NAME}")
    gains = maps.new_tensor(GAINS)[:, None, None]
    levels = (LEVELS * (0.5 + gains * (maps - 0.5))).round().clamp(0, LEVELS)
    frames = rearrange(levels, "view plane h w -> (plane view) h w").numpy().astype("<u2")
    encoder = av.CodecContext.create("libx265", "w")
    encoder.height, encoder.width, encoder.pix_fmt = *frames.shape[1:], FORMAT
    encoder.framerate, encoder.time_base = Fraction(25), Fraction(1, 25)
    parameters = f"qp={qp}:ipratio=1:bframes=0:keyint=-1:repeat-headers=1:info=0:log-level=none"
    encoder.options = {"preset": "veryslow", "x265-params": f"{parameters}:pools=1:frame-threads=1"}
    packets = [packet for number, frame in enumerate(frames) for packet in encoder.encode(_frame(frame, number))]
    return b"".join(map(bytes, (*packets, *encoder.encode(None))))


def _frame(levels: UInt16[np.ndarray, "h w"], number: int) -> object:
    frame = require_extra("av", f"coding {NAME}").VideoFrame.from_ndarray(levels, format=FORMAT)
    frame.pts = number
    return frame


def decode_maps(data: bytes, num_views: int) -> Maps:
    """Decode the bytes of `encode_maps`. Raises InputError if PyAV is not installed."""
    decoder = require_extra("av", f"decoding {NAME}").CodecContext.create("hevc", "r")
    packets = (*decoder.parse(data), *decoder.parse(None), None)
    frames = [frame.to_ndarray() for packet in packets for frame in decoder.decode(packet)]
    levels = torch.from_numpy(np.stack(frames).astype(np.float32) / LEVELS)
    maps = rearrange(levels, "(plane view) h w -> view plane h w", view=num_views)
    return (0.5 + (maps - 0.5) / maps.new_tensor(GAINS)[:, None, None]).clamp(0.0, 1.0)
