"""Convert the colours of photographs and videos to sRGB: ICC profiles, wide gamuts and HDR.

Primaries and transfer functions of videos, HEIC and AVIF are numbers of ITU-T H.273.
"""

from io import BytesIO

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageCms

SRGB_PRIMARIES = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290))  # red, green, blue, white: CIE xy
_BT2020 = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), (0.3127, 0.3290))
_DISPLAY_P3 = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), (0.3127, 0.3290))
_ADOBE_RGB = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06), (0.3127, 0.3290))
_ADOBE_RGB_EXPONENT = 563 / 256
_WIDE_GAMUTS = {9: _BT2020, 12: _DISPLAY_P3}  # by H.273 colour primaries; others differ little from sRGB
_PQ, _HLG = 16, 18  # H.273 transfer characteristics
_WHITE_NITS = 203.0  # reference white of HDR (ITU-R BT.2408), which becomes white
_HLG_WHITE = 0.75  # its HLG signal
_HLG_SYSTEM_GAMMA = 1.2  # of a display of 1000 nits (ITU-R BT.2100)
_KNEE = 0.8  # linear light above this is compressed into what remains up to 1
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
_BAND_ROWS = 256  # converted at a time, so that large photographs need little memory
_MODES_OF_PROFILE = {"RGB ": ("RGB",), "GRAY": ("L",), "CMYK": ("CMYK",)}
_SAME_LEVELS = 2  # a profile that changes no 8-bit level by more than this is sRGB

Chromaticities = tuple[tuple[float, float], tuple[float, float], tuple[float, float], tuple[float, float]]
Pixels = Float[np.ndarray, "height width 3"]


def is_hdr(transfer: int) -> bool:
    """Return whether a transfer function is PQ or HLG."""
    return transfer in (_PQ, _HLG)


def is_srgb(primaries: int, transfer: int) -> bool:
    """Return whether pixels with these numbers of H.273 are taken as sRGB, as all of SDR with BT.709 primaries are."""
    return primaries not in _WIDE_GAMUTS and not is_hdr(transfer)


def coded_to_srgb(pixels: Pixels, primaries: int, transfer: int) -> None:
    """Convert pixels in [0, 1], in place, from primaries and a transfer function of H.273 to sRGB.

    HDR is tone-mapped: reference white and what is darker keep their light, highlights are compressed. HLG becomes the
    light of a display of 1000 nits (ITU-R BT.2100). Other transfer functions are taken for that of sRGB.
    """
    matrix = primaries_to_srgb(_WIDE_GAMUTS.get(primaries, SRGB_PRIMARIES))
    for top in range(0, len(pixels), _BAND_ROWS):
        band = pixels[top : top + _BAND_ROWS]
        if transfer == _PQ:
            light = _pq_to_linear(band)
        elif transfer == _HLG:
            light = _hlg_to_linear(band)
        else:
            light = srgb_to_linear(band)
        light = light @ matrix.T
        band[:] = linear_to_srgb(_compress_highlights(light) if is_hdr(transfer) else light)


def adobe_rgb_to_srgb(samples: UInt8[np.ndarray, "height width 3"]) -> UInt8[np.ndarray, "height width 3"]:
    """Convert Adobe RGB (1998)."""
    matrix = primaries_to_srgb(_ADOBE_RGB).T
    converted = np.empty_like(samples)
    for top in range(0, len(samples), _BAND_ROWS):
        light = (samples[top : top + _BAND_ROWS] / np.float32(255)) ** _ADOBE_RGB_EXPONENT @ matrix
        converted[top : top + _BAND_ROWS] = np.rint(255 * linear_to_srgb(light))
    return converted


def primaries_to_srgb(primaries: Chromaticities) -> Float[np.ndarray, "3 3"]:
    """Return the matrix from linear RGB with these primaries and white to linear sRGB (white adapted by Bradford)."""
    source, target = _rgb_to_xyz(primaries), _rgb_to_xyz(SRGB_PRIMARIES)
    cones = [_BRADFORD @ matrix.sum(axis=1) for matrix in (source, target)]  # of both whites
    adapt = np.linalg.solve(_BRADFORD, np.diag(cones[1] / cones[0]) @ _BRADFORD)
    return (np.linalg.solve(target, adapt @ source)).astype(np.float32)


def xyz_to_srgb() -> Float[np.ndarray, "3 3"]:
    """Return the matrix from CIE XYZ, of which Y is 1 and the chromaticity D65 for white, to linear sRGB."""
    return np.linalg.inv(_rgb_to_xyz(SRGB_PRIMARIES)).astype(np.float32)


def luminance_weights(primaries: Chromaticities) -> Float[np.ndarray, "3"]:
    """Return the luminance of red, green and blue of these primaries; their sum is 1."""
    return _rgb_to_xyz(primaries)[1]


def _rgb_to_xyz(primaries: Chromaticities) -> Float[np.ndarray, "3 3"]:
    columns = np.array([(x / y, 1.0, (1 - x - y) / y) for x, y in primaries]).T
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3])


def linear_to_srgb(linear: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Apply the sRGB transfer function (IEC 61966-2-1) to linear values, clipped to [0, 1]."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def srgb_to_linear(srgb: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Apply the inverse of the sRGB transfer function (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0) + 0.055) / 1.055) ** 2.4)


def _pq_to_linear(signal: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Return light in units of reference white (SMPTE ST 2084)."""
    power = signal ** (32 / 2523)
    light = np.maximum(power - 107 / 128, 0) / (2413 / 128 - 2392 / 128 * power)
    return light ** (8192 / 1305) * (10_000 / _WHITE_NITS)


def _hlg_to_linear(signal: Float[np.ndarray, "*shape 3"]) -> Float[np.ndarray, "*shape 3"]:
    """Return the light of a display in units of reference white (ITU-R BT.2100)."""
    scene = _hlg_to_scene_light(signal)
    luminance = scene @ np.array([0.2627, 0.6780, 0.0593], np.float32)
    gain = np.maximum(luminance, 1e-6) ** (_HLG_SYSTEM_GAMMA - 1)
    return scene * gain[..., None] / _hlg_to_scene_light(np.float32(_HLG_WHITE)) ** _HLG_SYSTEM_GAMMA


def _hlg_to_scene_light(signal: Float[np.ndarray, "*shape"] | np.float32) -> Float[np.ndarray, "*shape"]:
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.where(signal <= 0.5, signal**2 / 3, (np.exp((signal - c) / a) + b) / 12)


def _compress_highlights(light: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Return light below 1: the identity up to the knee, then a curve of slope 1 at the knee."""
    room = 1 - _KNEE
    return np.where(light <= _KNEE, light, 1 - room**2 / (np.maximum(light, _KNEE) - _KNEE + room))


def profile_to_srgb(image: Image.Image, profile: bytes) -> Image.Image:
    """Convert an 8-bit image by its ICC profile, with relative colorimetric intent; the result is RGB or RGBA.

    A profile that is damaged, not of the image's kind or sRGB itself changes nothing, as in browsers.
    """
    try:
        source = ImageCms.ImageCmsProfile(BytesIO(profile))
        modes = _MODES_OF_PROFILE.get(source.profile.xcolor_space, ())
        alpha = image.convert("RGBA").getchannel("A") if image.has_transparency_data else None
        grey = image.mode in ("1", "L", "LA")
        mode = "CMYK" if image.mode == "CMYK" else "L" if grey and "L" in modes else "RGB"
        if mode not in modes:
            return image
        intent, flags = ImageCms.Intent.RELATIVE_COLORIMETRIC, ImageCms.Flags.BLACKPOINTCOMPENSATION
        transform = ImageCms.buildTransform(source, ImageCms.createProfile("sRGB"), mode, "RGB", intent, flags)
        if mode == "RGB" and _changes_nothing(transform):
            return image
        converted = ImageCms.applyTransform(image.convert(mode), transform)
    except (ImageCms.PyCMSError, OSError, ValueError):
        return image
    assert converted is not None  # None is for transforms in place
    if alpha is not None:
        converted.putalpha(alpha)
    return converted


def _changes_nothing(transform: ImageCms.ImageCmsTransform) -> bool:
    levels = np.linspace(0, 255, 9).astype(np.uint8)
    colours = np.stack(np.meshgrid(levels, levels, levels), axis=-1).reshape(27, 27, 3)
    converted = ImageCms.applyTransform(Image.fromarray(colours), transform)
    return int(np.abs(np.asarray(converted).astype(int) - colours).max()) <= _SAME_LEVELS
