"""Encoding and decoding do not depend on the number of threads or the vector width."""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from fecocodec.coding.payload import decode_latents, encode_latents
from tests.coding.coding_examples import lively_prior, smooth_latents

ROOT = Path(__file__).resolve().parents[2]
LIMITS = [
    {"OMP_NUM_THREADS": "1"},
    {"OMP_NUM_THREADS": "2"},
    {"OMP_NUM_THREADS": "1", "ATEN_CPU_CAPABILITY": "default", "ONEDNN_MAX_CPU_ISA": "SSE41"},
    {"OMP_NUM_THREADS": "2", "MKL_ENABLE_INSTRUCTIONS": "SSE4_2", "ATEN_CPU_CAPABILITY": "avx2"},
]
SIZE = (2, 16, 16)

# Codes both stages, and decodes the payload of another process.
CHILD = """
import json, sys
sys.path.insert(0, sys.argv[1])
from tests.coding.test_same_bits import decode_both, encode_both
written = [bytes.fromhex(text) for text in json.loads(sys.stdin.read())]
mine, digests = encode_both()
print(json.dumps([[payload.hex() for payload in mine], digests, decode_both(written)]))
"""


def encode_both() -> tuple[list[bytes], list[str]]:
    prior, (y, z) = lively_prior(), smooth_latents(*SIZE)
    first, coded = encode_latents(prior, y, z, 600, 1, None)
    second, coded_again = encode_latents(prior, y * 0.3, z, 600, 2, coded.y_hat)
    return [first, second], [fingerprint(coded.y_hat), fingerprint(coded_again.y_hat)]


def decode_both(payloads: list[bytes]) -> list[str]:
    first = decode_latents(lively_prior(), payloads[0], SIZE, 600, 1, None)
    second = decode_latents(lively_prior(), payloads[1], SIZE, 600, 2, first.y_hat)
    return [fingerprint(first.y_hat), fingerprint(second.y_hat)]


def fingerprint(values: torch.Tensor) -> str:
    return hashlib.sha256(values.contiguous().numpy().tobytes()).hexdigest()


@pytest.mark.parametrize("limits", LIMITS, ids=lambda limits: " ".join(limits.values()))
def test_children_write_and_read_the_same(limits: dict[str, str]):
    payloads, values = encode_both()
    child = subprocess.run(
        [sys.executable, "-c", CHILD, str(ROOT)],
        input=json.dumps([payload.hex() for payload in payloads]),
        env={**os.environ, **limits},
        capture_output=True,
        text=True,
        check=True,
    )
    theirs, their_values, read = json.loads(child.stdout)
    assert [bytes.fromhex(text) for text in theirs] == payloads
    assert their_values == values == read
