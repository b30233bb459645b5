"""The estimated rate and latents of training match the bitstream and the decoded latents.

The chosen symbol is the nearest one, or the next one towards zero if that lowers the rate-distortion cost.
"""

import numpy as np
import pytest
import torch

from fecocodec.coding.payload import code_latents, encode_latents
from fecocodec.coding.priors import EntropyParameters, LatentPrior
from fecocodec.coding.rate import Softening, estimate_latents, rounding, straight_through, uniform_noise
from fecocodec.coding.symbol_choice import PRICES, choose_symbols, price_of_bits, symbol_bits
from fecocodec.container.lambda_quantisation import LAMBDA_Q_MAX
from fecocodec.entropy.symbol_coders import SymbolCoder
from fecocodec.entropy.tables import FIRST_CODED_TABLE, SYMBOL_LIMIT, load_tables
from tests.coding.coding_examples import lively_prior, smooth_latents


class Sampler(SymbolCoder):
    """Replaces a symbol writer: draws symbols from the tables, so that latents follow the entropy model exactly."""

    def __init__(self) -> None:
        self.rng = np.random.default_rng(0)

    def _code(self, model: object, wanted: np.ndarray | None, count: int) -> np.ndarray:
        raise AssertionError("exchange draws all symbols")

    _code_uniform = _code

    def exchange(self, table_index: np.ndarray, wanted: np.ndarray | None) -> np.ndarray:
        drawn = np.round(self.rng.normal(size=table_index.shape) * 2.0 ** ((table_index - 22) / 7))
        return np.where(table_index < FIRST_CODED_TABLE, 0, drawn).astype(np.int32)


def latents_of(prior: LatentPrior, stage: int, context: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
    drawn = code_latents(prior, Sampler(), 900, stage, context, (2, 4, 4), None)
    return drawn.y_hat, drawn.z_hat


@pytest.mark.parametrize("stage", [1, 2])
@pytest.mark.parametrize("prior", [LatentPrior(), lively_prior()], ids=["fresh", "lively"])
def test_estimate_is_the_length_of_the_payload(prior: LatentPrior, stage: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(PRICES, stage, (0.1, 0.1))  # higher prices depend more on rounded table indices
    context = None if stage == 1 else latents_of(prior, 1, None)[0]
    y, z = latents_of(prior, stage, context)
    payload, coded = encode_latents(prior, y, z, 900, stage, context)
    estimate = estimate_latents(prior, y, z, torch.tensor([900, 900]), stage, context, rounding(straight_through))
    estimated_bits = float((estimate.bits_y + estimate.bits_z).sum().detach())
    assert estimated_bits == pytest.approx(8 * len(payload), rel=0.02)
    assert (estimate.y_hat - coded.y_hat).detach().abs().double().mean() < 1 / 256
    assert torch.equal(estimate.z_hat, coded.z_hat)


def test_bits_are_those_of_the_tables():
    for index in range(FIRST_CODED_TABLE, 64, 3):
        table = load_tables()[index]
        near = 3 * table.reach // 8  # three standard deviations
        symbols = torch.arange(-near, near + 1).float()
        estimated = symbol_bits(symbols, torch.full_like(symbols, index))
        exact = 24 - np.log2(table.frequencies[table.reach - near : table.reach + near + 1].astype(float))
        assert np.allclose(estimated.numpy(), exact, atol=0.06)


def test_each_item_has_its_own_lambda_and_bits():
    prior, (y, z) = lively_prior(), smooth_latents(3, 8, 8)
    together = estimate_latents(prior, y, z, torch.tensor([0, 800, 1768]), 1, None, rounding(straight_through))
    for item, lambda_q in enumerate((0, 800, 1768)):
        alone = estimate_latents(
            prior, y[item : item + 1], z[item : item + 1], torch.tensor([lambda_q]), 1, None, rounding(straight_through)
        )
        assert torch.allclose(together.bits_y[item], alone.bits_y[0], rtol=1e-3)
        assert torch.allclose(together.bits_z[item], alone.bits_z[0], rtol=1e-3)


def test_everything_has_a_finite_gradient_at_extremes():
    prior, (y, z) = lively_prior(), smooth_latents(2, 8, 8)
    y[0, :, 0] *= 1e5
    z[1, 0] = -3e4
    y.requires_grad_(), z.requires_grad_()
    context = torch.randn(2, 32, 8, 8).requires_grad_()
    noise = uniform_noise(torch.Generator().manual_seed(0))
    estimate = estimate_latents(prior, y, z, torch.tensor([0, 1768]), 2, context, rounding(noise))
    (estimate.y_hat.square().mean().log() + estimate.bits_y.sum() + estimate.bits_z.sum()).backward()
    for tensor in (y, z, context, *prior.parameters()):
        assert tensor.grad is not None and bool(tensor.grad.isfinite().all()) and bool(tensor.grad.any())


def test_noise_is_in_the_gradient_and_comes_from_the_generator():
    prior, (y, z) = lively_prior(), smooth_latents(1, 8, 8)

    def bits_and_slope(soften: Softening) -> tuple[torch.Tensor, torch.Tensor]:
        latent = y.clone().requires_grad_()
        bits = estimate_latents(prior, latent, z, torch.tensor([100]), 1, None, rounding(soften)).bits_y
        bits.sum().backward()
        return bits.detach(), latent.grad

    same_bits, slope = bits_and_slope(uniform_noise(torch.Generator().manual_seed(1)))
    bits, slope_again = bits_and_slope(uniform_noise(torch.Generator().manual_seed(1)))
    other_bits, other_slope = bits_and_slope(uniform_noise(torch.Generator().manual_seed(2)))
    assert torch.equal(slope, slope_again)
    assert not torch.equal(slope, other_slope)
    assert torch.equal(bits, same_bits)
    assert torch.equal(bits, other_bits)
    assert torch.equal(bits, bits_and_slope(straight_through)[0])


def test_skipped_elements_cost_nothing_and_are_their_mean():
    values = torch.tensor([0.25, 3.0], requires_grad=True)
    position = torch.full((2,), -2000.0, requires_grad=True)
    parameters = EntropyParameters(torch.full((2,), 64.0), position)
    symbols, bits = rounding(straight_through)(values - 0.25, parameters, torch.tensor(0.1))
    assert symbols.tolist() == [0.0, 0.0] and bits.tolist() == [0.0, 0.0]
    bits.sum().backward()
    assert position.grad is not None and values.grad is not None
    assert position.grad[1] < 0, "descent widens the table of an element that is far from its mean"
    assert position.grad[0] == 0, "and leaves one that is at its mean where it is"
    assert values.grad[1] > 0


def test_autocast_changes_nothing():
    prior, (y, z) = lively_prior(), smooth_latents(1, 8, 8)
    plain = estimate_latents(prior, y, z, torch.tensor([5]), 1, None, rounding(straight_through))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        under = estimate_latents(prior, y, z, torch.tensor([5]), 1, None, rounding(straight_through))
    assert torch.equal(plain.bits_y, under.bits_y) and torch.equal(plain.y_hat, under.y_hat)


SIGMA_HALF, SIGMA_ONE, SIGMA_58 = 15.0, 22.0, 63.0  # tables
RESIDUALS = torch.linspace(-6.0, 6.0, 2401)


def chosen(residuals: torch.Tensor, table: float, price: float) -> torch.Tensor:
    return choose_symbols(residuals, torch.full_like(residuals, table), torch.tensor(price))


def test_which_symbols_are_chosen() -> None:
    assert torch.equal(chosen(RESIDUALS, SIGMA_HALF, 0.0), (RESIDUALS + 0.5).floor())
    firsts = [float(RESIDUALS[(chosen(RESIDUALS, table, 0.1) > 0.5)].min()) for table in (12.0, SIGMA_ONE, SIGMA_58)]
    assert firsts[0] > firsts[1] > firsts[2] >= 0.5
    outliers = torch.tensor([3e6, -3e6, 1e5])
    assert chosen(outliers, 6.0, 0.1).tolist() == [SYMBOL_LIMIT, -SYMBOL_LIMIT, 100000]
    odd = RESIDUALS[RESIDUALS.frac().abs() != 0.5]
    assert torch.equal(chosen(odd, SIGMA_ONE, 0.1), -chosen(-odd, SIGMA_ONE, 0.1))
    lambda_q = torch.tensor([0, 884, 1768])
    assert price_of_bits(lambda_q, 1).tolist() == pytest.approx([0.35, 0.255, 0.16])
    assert price_of_bits(lambda_q, 2).tolist() == pytest.approx([0.3, 0.175, 0.05])
    assert float(price_of_bits(torch.tensor([LAMBDA_Q_MAX + 2 * 255]), 1)) > 0  # of the coarsest first stage


@pytest.mark.parametrize("table", [SIGMA_HALF, SIGMA_ONE, SIGMA_58])
def test_what_is_chosen_is_the_best_of_all_symbols_but_for_jumps(table: float) -> None:
    """Compares squared error + price x bits with a full search; the choice is at most one step from the nearest."""
    price, symbols = 0.1, torch.arange(-7.0, 8.0)
    bits = symbol_bits(symbols, torch.full_like(symbols, table))
    cost = (RESIDUALS[:, None] - symbols).square() + price * bits
    is_near = (symbols - (RESIDUALS[:, None] + 0.5).floor()).abs() <= 1
    best = symbols[torch.where(is_near, cost, torch.inf).argmin(dim=1)]
    found = chosen(RESIDUALS, table, price)
    taken = cost.gather(1, (found + 7).long()[:, None])[:, 0]
    torch.testing.assert_close(taken, cost.gather(1, (best + 7).long()[:, None])[:, 0], atol=1e-4, rtol=0)


def test_a_payload_is_shorter_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    prior, (y, z) = lively_prior(), smooth_latents(2, 16, 16)
    sizes = []
    for price in (0.0, 0.12):
        monkeypatch.setitem(PRICES, 1, (price, price))
        sizes.append(len(encode_latents(prior, y, z, 0, 1, None)[0]))
    assert sizes[1] < sizes[0]
