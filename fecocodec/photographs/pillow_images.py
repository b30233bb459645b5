"""Decode photographs of all kinds but OpenEXR with Pillow. Bounds the number of pixels and raises only InputError."""

import struct
import warnings
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8, UInt16
from PIL import ExifTags, Image, UnidentifiedImageError
from PIL.TiffImagePlugin import TiffImageFile

from fecocodec.errors import InputError, installation
from fecocodec.input_file import MAX_IMAGE_PIXELS, first_bytes, require_regular_file
from fecocodec.photographs.colour import adobe_rgb_to_srgb, profile_to_srgb
from fecocodec.photographs.orientation import LAST_ORIENTATION, UPRIGHT, as_stored, turned_upright
from fecocodec.photographs.png16 import HEAD_BYTES, decode_sixteen_bits, has_sixteen_bits
from fecocodec.photographs.silence import silenced
from fecocodec.photographs.stated_colours import COLOUR_BYTES, Samples, coded_colours, stated_to_srgb

_FORMATS = ("PNG", "JPEG", "WEBP", "AVIF", "TIFF", "BMP")
RAW_SUFFIXES = (
    ".dng", ".cr2", ".cr3", ".crw", ".nef", ".nrw", ".arw", ".sr2", ".orf", ".raf", ".rw2", ".pef", ".srw", ".x3f",
    ".3fr", ".iiq", ".raw", ".gpr", ".rwl", ".dcr", ".kdc", ".mrw", ".erf", ".mef", ".mos",
)  # fmt: skip
_HEIC_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
_CODED_COLOURS = ("HEIF", "AVIF", "PNG")
_USUAL_GAMMA, _SAME_GAMMA = 1 / 2.2, 0.05  # of files whose values are taken as sRGB


def decode_with_pillow(source: Path | BytesIO, place: Path | str) -> Float[np.ndarray, "channel height width"]:
    """Return 3 channels of sRGB in [0, 1], or 4 if the image has opacity (not premultiplied).

    Raises InputError, which begins with `place`, if the image is missing, damaged, too large or of another format.
    """
    return _in_unit_range(_read_samples(source, place))


def upright_with_pillow(path: Path) -> Image.Image:
    """Return a photograph, upright by EXIF, as 8-bit sRGB on white. Raises InputError as `decode_with_pillow` does."""
    samples = _read_samples(path, path)
    if samples.dtype == np.uint16:
        samples = np.rint(samples / np.float32(257)).astype(np.uint8)
    if samples.shape[2] <= 2:
        samples = np.concatenate((np.repeat(samples[..., :1], 3, axis=2), samples[..., 1:]), axis=2)
    image = Image.fromarray(np.ascontiguousarray(samples))
    if image.mode == "RGBA":
        image = Image.alpha_composite(Image.new("RGBA", image.size, "white"), image).convert("RGB")
    return turned_upright(image, orientation_with_pillow(path))


def size_with_pillow(path: Path) -> tuple[int, int]:
    """Return (height, width) as stored, from the header alone. Raises InputError as `decode_with_pillow` does."""
    with open_image(path, path) as image:
        if isinstance(image, TiffImageFile):  # its size is that after turning upright
            return image.tag_v2[ExifTags.Base.ImageLength], image.tag_v2[ExifTags.Base.ImageWidth]
        return image.height, image.width


def orientation_with_pillow(path: Path) -> int:
    """Return the EXIF orientation of the decoded pixels, from 1 (upright) to 8; 1 without readable EXIF data.

    Raises InputError as `decode_with_pillow` does for an image that cannot be opened.
    """
    with open_image(path, path) as image:
        return UPRIGHT if image.format == "HEIF" else _orientation(image)  # its decoder turns the pixels


def _orientation(image: Image.Image) -> int:
    found = exif_value(image, ExifTags.Base.Orientation)
    return found if isinstance(found, int) and UPRIGHT <= found <= LAST_ORIENTATION else UPRIGHT


def gamma_with_pillow(path: Path) -> float | None:
    """Return the exponent of a PNG's gAMA chunk if its values are converted to sRGB for it, None otherwise.

    Raises InputError as `decode_with_pillow` does for an image that cannot be opened.
    """
    with open_image(path, path) as image:
        return None if coded_colours(_head(path, COLOUR_BYTES)) else _gamma(image)


def has_several_pictures(path: Path) -> bool:
    """Return whether a file has further pictures, such as pages, that are not read. Raises InputError as above."""
    with open_image(path, path) as image:
        is_kind = image.format in ("TIFF", "PNG", "WEBP", "AVIF", "HEIF")  # MPO has previews
        try:
            return is_kind and getattr(image, "n_frames", 1) > 1
        except Exception:  # damage behind the first picture, which Pillow reports in many ways
            return False


def _gamma(image: Image.Image) -> float | None:
    """Return the exponent of a PNG's gAMA chunk; None if it is about that of sRGB, or another chunk outranks it."""
    gamma = (image.info.get("gamma") or 0.0) if image.format == "PNG" else 0.0
    is_outranked = "srgb" in image.info or "icc_profile" in image.info
    return None if is_outranked or gamma <= 0 or abs(gamma - _USUAL_GAMMA) < _SAME_GAMMA else gamma


def exif_value(image: Image.Image, tag: int, ifd: int | None = None) -> object:
    """Return a value of the EXIF data, from their main directory or from `ifd`; None if it is not there or damaged."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about damaged EXIF data
        try:
            exif = image.getexif()
            value: object = (exif if ifd is None else exif.get_ifd(ifd)).get(tag)
        except (OSError, SyntaxError, ValueError, struct.error):  # what Pillow raises for damaged EXIF data
            return None
    return value


def require_few_pixels(height: int, width: int, place: Path | str) -> None:
    """Raise InputError if an image has more than MAX_IMAGE_PIXELS pixels."""
    if height * width > MAX_IMAGE_PIXELS:
        raise InputError(
            f"{place}: the image has too many pixels ({width}x{height}, at most {MAX_IMAGE_PIXELS} in all); "
            "store it smaller."
        )


def unreadable(place: Path | str, error: Exception) -> str:
    """Return the error message for an image that cannot be read."""
    if isinstance(error, FileNotFoundError):
        return f"{place}: no such image; put it there or leave its view out."
    if isinstance(error, OSError) and error.strerror:  # from the system; Pillow's own errors have none
        return f"{place}: cannot be read ({error.strerror}); check the path and its permissions."
    has_reason = str(error) and not isinstance(error, UnidentifiedImageError)  # which only repeats the path
    reason = f" ({' '.join(str(error).split())})" if has_reason else ""
    return (
        f"{place}: the image is damaged, cut short or of a kind that is not read{reason}; store it again or remove it."
    )


def open_image(source: Path | BytesIO, place: Path | str) -> Image.Image:
    """Open an image with Pillow, which reads its header. Raises InputError as `decode_with_pillow` does.

    Kinds are recognised by content; only RAW is by name, because many RAW files are TIFF files of a preview.
    """
    try:
        return _opened(source, place)
    except (InputError, MemoryError):
        raise
    except Exception as error:  # Pillow reports damage in many ways: OSError, SyntaxError, AssertionError, struct.error
        raise InputError(unreadable(place, error)) from error


def _opened(source: Path | BytesIO, place: Path | str) -> Image.Image:
    if isinstance(source, Path):
        require_regular_file(source)
        if source.suffix.lower() in RAW_SUFFIXES:
            raise InputError(f"{place}: RAW photographs are not read; develop it to JPEG, TIFF or PNG.")
    formats: tuple[str, ...] = _FORMATS
    if _head(source, 12)[4:] in [b"ftyp" + brand for brand in _HEIC_BRANDS]:
        _register_heic(place)
        formats = (*_FORMATS, "HEIF")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about damage that Pillow repairs, and about sizes, which are checked below
        try:
            image = Image.open(source, formats=formats)
        except Image.DecompressionBombError as error:
            raise InputError(f"{place}: the image has too many pixels; store it smaller.") from error
    require_few_pixels(image.height, image.width, place)
    return image


def _register_heic(place: Path | str) -> None:
    try:
        import pillow_heif
    except ImportError as error:
        raise InputError(
            f"{place}: HEIC photographs need the package pillow-heif; run {installation('heic')}, or convert it to "
            "JPEG."
        ) from error
    pillow_heif.register_heif_opener()


def _head(source: Path | BytesIO, count: int) -> bytes:
    """Return the first `count` bytes, or all of them."""
    return source.getvalue()[:count] if isinstance(source, BytesIO) else first_bytes(source, count)


def _read_samples(source: Path | BytesIO, place: Path | str) -> Samples:
    """Return sRGB samples with 3 or 4 channels, or grey ones with 1 or 2; the last of 2 and 4 is opacity."""
    try:
        with open_image(source, place) as image:
            if has_sixteen_bits(_head(source, HEAD_BYTES)):
                profile = image.info.get("icc_profile")
                data = source.getvalue() if isinstance(source, BytesIO) else source.read_bytes()
                samples = decode_sixteen_bits(data, str(place), profile)
                return samples if profile else stated_to_srgb(samples, data[:COLOUR_BYTES], _gamma(image))
            if image.format != "TIFF":
                return _samples(image, source, place)
            orientation = _orientation(image)
            with silenced():  # libtiff prints what is damaged
                return as_stored(_samples(image, source, place), orientation)
    except (InputError, MemoryError):
        raise
    except Exception as error:  # as above
        raise InputError(unreadable(place, error)) from error


def _samples(image: Image.Image, source: Path | BytesIO, place: Path | str) -> Samples:
    """Return the samples of an image that Pillow decodes."""
    if image.mode.startswith("I;16"):
        return np.asarray(image).astype(np.uint16)[..., None]
    if image.mode in ("I", "F"):
        raise InputError(
            f"{place}: its values have 32 bits, of which the range is unknown; store it with 8 or 16 bits a channel."
        )
    profile = image.info.get("icc_profile")
    if profile:
        image = profile_to_srgb(image, profile)
    samples = np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB"))
    if profile:
        return samples
    if exif_value(image, 1, ExifTags.IFD.Interop) == "R03":
        return np.concatenate((adobe_rgb_to_srgb(samples[..., :3]), samples[..., 3:]), axis=2)
    if image.format not in _CODED_COLOURS:
        return samples
    return stated_to_srgb(samples, _head(source, COLOUR_BYTES), _gamma(image))


def _in_unit_range(
    samples: UInt8[np.ndarray, "height width samples"] | UInt16[np.ndarray, "height width samples"],
) -> Float[np.ndarray, "channel height width"]:
    """Return 3 or 4 channels in [0, 1]; grey, with or without opacity, becomes three equal channels."""
    count = samples.shape[2]
    order = {1: (0, 0, 0), 2: (0, 0, 0, 1)}.get(count, tuple(range(count)))
    largest = np.float32(np.iinfo(samples.dtype).max)
    pixels = np.empty((len(order), *samples.shape[:2]), np.float32)
    for channel, plane in zip(order, pixels, strict=True):  # one at a time, to need little memory
        np.divide(samples[..., channel], largest, out=plane, dtype=np.float32)
    return pixels
