"""`decode_intact`: what can still be decoded of a damaged stream."""

from dataclasses import dataclass, replace
from pathlib import Path

from fecocodec.checkpoint import SHIPPED
from fecocodec.container import Stream, read_intact
from fecocodec.errors import BitstreamError
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.decode import MAX_SH_DEGREE, OnProgress, decode_stream, receiver_of
from fecocodec.receiver.model import Receiver


@dataclass(frozen=True)
class IntactDecoding:
    """Gaussians of the stages that are undamaged. damage: what is wrong with the rest; None: nothing."""

    gaussians: Gaussians
    num_stages: int
    damage: str | None


def decode_intact(
    data: bytes,
    *,
    sh_degree: int = MAX_SH_DEGREE,
    device: str = "cpu",
    weights: str | Path = SHIPPED,
    on_progress: OnProgress = lambda _task, _fraction: None,
) -> IntactDecoding:
    """Decode as many stages of a `.fcs` stream as are undamaged; the other options are those of `decode`.

    Raises BitstreamError where not even the first stage can be decoded, ModelError where its weights are not found.
    """
    part = read_intact(data)
    receiver = receiver_of(part.stream.header.model_id, weights, device)
    gaussians, num_stages, damage = _longest(part.stream, receiver, on_progress, sh_degree)
    return IntactDecoding(gaussians, num_stages, part.damage or damage)


def _longest(
    stream: Stream, receiver: Receiver, on_progress: OnProgress, sh_degree: int
) -> tuple[Gaussians, int, str | None]:
    """All stages, or those before one whose symbols are not what its checksum promised."""
    damage: str | None = None
    while True:
        try:
            return decode_stream(stream, receiver, on_progress, sh_degree), len(stream.payloads), damage
        except BitstreamError as error:
            if len(stream.payloads) == 1:
                raise
            damage = str(error)
            stream = replace(stream, payloads=stream.payloads[:-1], keep=None, metadata=None)
