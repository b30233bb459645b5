"""Valid streams of random symbols and cameras, however extreme, decode to finite Gaussians."""

from random import Random

import numpy as np
import pytest

from fecocodec.checkpoint import RECEIVER_FILE, model_folder
from fecocodec.decoding import decode
from fecocodec.receiver.model import load_receiver
from tests.fuzzing.forgeries import code_random_latents, forged_stream


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_forgeries_are_decoded() -> None:
    receiver, model_id = load_receiver(model_folder(None) / RECEIVER_FILE)
    random, counts = Random(3), []
    latents = [code_random_latents(random, receiver, model_id) for _ in range(4)]
    for _ in range(8):
        decoded = decode(forged_stream(random, latents), num_threads=1)
        assert decoded.damage is None
        assert all(bool(np.isfinite(field).all()) for field in decoded.gaussians.fields())
        counts.append(decoded.gaussians.count)
    assert sorted(counts)[len(counts) // 2] > 100
