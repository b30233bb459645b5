"""Valid streams of random symbols and cameras, however extreme, decode to finite Gaussians."""

from random import Random

import numpy as np
import pytest

from fecocodec.checkpoint import RECEIVER_FILE, model_folder
from fecocodec.container import check_symbol_digest, read_stream
from fecocodec.decoding import decode
from fecocodec.errors import BitstreamError
from fecocodec.receiver.model import load_receiver
from tests.fuzzing.forgeries import CodedLatents, code_random_latents, forged_stream


@pytest.fixture(scope="module")
def latents() -> list[CodedLatents]:
    receiver, model_id = load_receiver(model_folder(None) / RECEIVER_FILE)
    random = Random(3)
    return [code_random_latents(random, receiver, model_id) for _ in range(6)]


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_forgeries_are_decoded(latents: list[CodedLatents]) -> None:
    random = Random(4)
    counts = []
    for _ in range(12):
        decoded = decode(forged_stream(random, latents), num_threads=1)
        assert decoded.damage is None
        assert all(bool(np.isfinite(field).all()) for field in decoded.gaussians.fields())
        counts.append(decoded.gaussians.count)
    assert sorted(counts)[len(counts) // 2] > 100


def test_their_digests_are_those_of_their_symbols(latents: list[CodedLatents]) -> None:
    """Otherwise they would be refused before the networks run."""
    header = read_stream(forged_stream(Random(5), latents)).header
    check_symbol_digest(header, 1, header.symbol_digests[0])
    with pytest.raises(BitstreamError, match="digest"):
        check_symbol_digest(header, 1, bytes(8))
