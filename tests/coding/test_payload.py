"""Coding of any latents is lossless after quantisation, and damage is detected."""

import numpy as np
import pytest
import torch

from fecocodec.checkpoint import serialise_weights
from fecocodec.coding.fixed_point import export_integers
from fecocodec.coding.payload import CodedLatents, decode_latents, encode_latents
from fecocodec.coding.symbol_choice import PRICES
from fecocodec.entropy.tables import SYMBOL_LIMIT
from fecocodec.errors import BitstreamError, InputError
from tests.bitstream_spec.second_reader import read_symbols
from tests.coding.coding_examples import lively_prior, smooth_latents


def assert_same(sent: CodedLatents, received: CodedLatents) -> None:
    assert all(np.array_equal(a, b) for a, b in zip(sent.symbols, received.symbols, strict=True))
    assert torch.equal(sent.y_hat, received.y_hat) and torch.equal(sent.z_hat, received.z_hat)
    assert sent.digest() == received.digest()


def test_stages_that_are_coded_apart_do_not_see_each_other():
    prior, size = lively_prior(), (1, 8, 8)
    (y, z), (other, _) = smooth_latents(*size), smooth_latents(*size, seed=1)
    found = {}
    for prior.codes_stages_apart in (False, True):
        found[prior.codes_stages_apart] = [encode_latents(prior, y, z, 700, 2, context)[0] for context in (y, other)]
    assert found[False][0] != found[False][1] and found[True][0] == found[True][1]


@pytest.mark.parametrize(("price", "most_off"), [(0.0, 0.5), (0.2, 1.5)])
def test_coded_elements_are_off_by_little_and_skipped_ones_are_their_mean(
    price: float, most_off: float, monkeypatch: pytest.MonkeyPatch
):
    """Errors are at most half a step if bits have no price, and one more step otherwise."""
    monkeypatch.setitem(PRICES, 1, (price, price))
    y, z = smooth_latents(2, 8, 8)
    _, coded = encode_latents(lively_prior(), y, z, 0, 1, None)
    zeros = torch.from_numpy(np.concatenate([s.ravel() for s in coded.symbols[1:]]) == 0)
    far = (coded.y_hat - y).abs() > most_off + 1e-6
    assert 0 < int(far.sum()) <= int(zeros.sum()), "an element that is further off was not coded: its symbol is zero"
    assert float(far.double().mean()) < 0.5


def test_no_latent_is_too_extreme_but_nan_is_refused():
    y, z = smooth_latents(1, 8, 8)
    with pytest.raises(InputError, match="NaN"):
        encode_latents(lively_prior(), y.masked_fill(y > 3, torch.nan), z, 0, 1, None)
    y[0, :, ::2] *= 1e4
    y[0, 3], y[0, 4], y[0, 5] = 1e30, -torch.inf, torch.inf
    z[0, :4] = 1e9
    prior = lively_prior()
    payload, sent = encode_latents(prior, y, z, 100, 1, None)
    assert max(int(np.abs(s).max()) for s in sent.symbols) == SYMBOL_LIMIT
    received = decode_latents(prior, payload, (1, 8, 8), 100, 1, None)
    assert_same(sent, received)
    again, _ = encode_latents(prior, *smooth_latents(1, 8, 8), 100, 2, sent.y_hat)
    assert again == encode_latents(prior, *smooth_latents(1, 8, 8), 100, 2, received.y_hat)[0]


@pytest.mark.parametrize("stage", [1, 2])
def test_decoding_is_what_the_specification_says(stage: int):
    prior, size, lambda_q = lively_prior(seed=4), (2, 8, 4), 1234
    y, z = smooth_latents(*size, seed=1)
    y[0, 7] *= 1000.0
    context = None if stage == 1 else encode_latents(prior, y, z, lambda_q, 1, None)[1].y_hat
    payload, sent = encode_latents(prior, y * 0.7, z, lambda_q, stage, context)

    weights = serialise_weights({f"prior.{name}": values for name, values in export_integers(prior).items()}, {})
    before = None if context is None else q8(context)
    read = read_symbols.decode_stage(read_symbols.read_model(weights), payload, size, lambda_q, stage, before)
    assert (read.z_hat, read.y_hat, read.digest) == (q8(sent.z_hat), q8(sent.y_hat), sent.digest())


def q8(values: torch.Tensor) -> list:
    """Return [view row column channel] in units of 1/256."""
    return (values.permute(0, 2, 3, 1).double() * 256).long().tolist()


def test_random_bytes_raise_or_are_the_only_encoding_of_what_they_say(monkeypatch: pytest.MonkeyPatch):
    """Random bytes are sometimes a valid payload; only the digest detects these."""
    monkeypatch.setitem(PRICES, 1, (0.0, 0.0))  # choose the nearest symbols
    rng = np.random.default_rng(1)
    prior, valid = lively_prior(), 0
    for length in (0, 1, 4, *[3] * 12, 39, 399, 3999):
        for _ in range(5):
            payload = rng.bytes(length) + b"\1"
            try:
                received = decode_latents(prior, payload, (1, 8, 8), 0, 1, None)
            except BitstreamError:
                continue
            again, sent = encode_latents(prior, received.y_hat, received.z_hat, 0, 1, None)
            assert again == payload
            assert_same(sent, received)
            valid += 1
    assert 0 < valid < 40
