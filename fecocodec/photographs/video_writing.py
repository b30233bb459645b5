"""Write an MP4 video (H.264) with PyAV, the `video` extra."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.atomic import write_atomically
from fecocodec.errors import OutputError
from fecocodec.input_file import StrPath
from fecocodec.photographs.video_frames import require_video_extra

QUALITY = "18"  # constant rate factor of x264; 18 is nearly transparent

AddFrame = Callable[[Float[Tensor, "3 height width"]], None]


@contextmanager
def video_writer(
    path: StrPath, image_size: tuple[int, int], frames_per_second: float, *, overwrite: bool = False
) -> Iterator[AddFrame]:
    """Yield a function that appends a frame (sRGB in [0, 1]) to the video; the file appears when the block ends.

    image_size: (height, width) in pixels; an odd side loses its last pixel, because the video stores colour at half
    resolution. Raises OutputError if PyAV is missing, or the video cannot be written.
    """
    require_video_extra()
    import av

    path = Path(path)
    height, width = (side - side % 2 for side in image_size)
    if min(height, width) < 2:
        raise OutputError(f"{path}: a video needs sides of at least 2 pixels; choose a larger image size.")
    with write_atomically(path, overwrite=overwrite) as temporary:
        try:
            with av.open(str(temporary), "w", format="mp4") as container:
                stream = container.add_stream("libx264", rate=Fraction(frames_per_second).limit_denominator(1001))
                stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
                stream.options = {"crf": QUALITY}

                def add_frame(image: Float[Tensor, "3 height width"]) -> None:
                    pixels = (image[:, :height, :width].clamp(0, 1) * 255).round().to(torch.uint8)
                    frame = av.VideoFrame.from_ndarray(rearrange(pixels, "rgb h w -> h w rgb").contiguous().numpy())
                    container.mux(stream.encode(frame))

                yield add_frame
                container.mux(stream.encode())
        except av.FFmpegError as error:
            raise OutputError(
                f"{path}: the video cannot be written ({error.strerror}); choose another path or image size."
            ) from error
