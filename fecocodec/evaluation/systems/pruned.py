"""The codec with `decode --prune`: fewer Gaussians for a longer decoding time."""

from functools import partial
from time import perf_counter

from fecocodec.evaluation.systems.codec import codec_system, rendered
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.views import Views
from fecocodec.rendering.pruning import prune
from fecocodec.sender.codec import Codec

PRUNED = "fecosplat, pruned"


def pruned_system(codec: Codec, lmbda: float) -> System:
    """Return `codec_system`, followed by pruning and refitting at cameras near the context cameras."""
    return System(PRUNED, f"lambda {lmbda:g}", partial(_reconstruct, codec_system(codec, lmbda)))


def _reconstruct(codec: System, views: Views, num_context: int) -> Reconstruction:
    found = codec.reconstruct(views, num_context)
    assert found.gaussians is not None  # a decoded stream has Gaussians
    begin = perf_counter()
    kept = prune(found.gaussians, views.cameras.select(list(range(num_context))), views.image_size)
    seconds = found.decode_seconds + perf_counter() - begin
    return rendered(kept, views, found.num_bytes, found.encode_seconds, seconds)
