"""The chosen symbol is the nearest one, or the next one towards zero if that lowers the rate-distortion cost."""

import pytest
import torch

from fecocodec.coding.payload import encode_latents
from fecocodec.coding.symbol_choice import PRICES, choose_symbols, price_of_bits, symbol_bits
from fecocodec.container.lambda_quantisation import LAMBDA_Q_MAX
from fecocodec.entropy.tables import SYMBOL_LIMIT
from tests.coding.coding_examples import lively_prior, smooth_latents

SIGMA_HALF, SIGMA_ONE, SIGMA_58 = 15.0, 22.0, 63.0  # tables
RESIDUALS = torch.linspace(-6.0, 6.0, 2401)


def chosen(residuals: torch.Tensor, table: float, price: float) -> torch.Tensor:
    return choose_symbols(residuals, torch.full_like(residuals, table), torch.tensor(price))


def test_bits_that_cost_nothing_leave_the_nearest() -> None:
    assert torch.equal(chosen(RESIDUALS, SIGMA_HALF, 0.0), (RESIDUALS + 0.5).floor())


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


def test_improbable_symbols_need_larger_residuals() -> None:
    firsts = [float(RESIDUALS[(chosen(RESIDUALS, table, 0.1) > 0.5)].min()) for table in (12.0, SIGMA_ONE, SIGMA_58)]
    assert firsts[0] > firsts[1] > firsts[2] >= 0.5


def test_outliers_and_mirror_images() -> None:
    outliers = torch.tensor([3e6, -3e6, 1e5])
    assert chosen(outliers, 6.0, 0.1).tolist() == [SYMBOL_LIMIT, -SYMBOL_LIMIT, 100000]
    odd = RESIDUALS[RESIDUALS.frac().abs() != 0.5]
    assert torch.equal(chosen(odd, SIGMA_ONE, 0.1), -chosen(-odd, SIGMA_ONE, 0.1))


def test_price_falls_as_lambda_rises() -> None:
    lambda_q = torch.tensor([0, 884, 1768])
    assert price_of_bits(lambda_q, 1).tolist() == pytest.approx([0.35, 0.255, 0.16])
    assert price_of_bits(lambda_q, 2).tolist() == pytest.approx([0.3, 0.175, 0.05])
    assert float(price_of_bits(torch.tensor([LAMBDA_Q_MAX + 2 * 255]), 1)) > 0  # of the coarsest first stage


def test_a_payload_is_shorter_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    prior, (y, z) = lively_prior(), smooth_latents(2, 16, 16)
    sizes = []
    for price in (0.0, 0.12):
        monkeypatch.setitem(PRICES, 1, (price, price))
        sizes.append(len(encode_latents(prior, y, z, 0, 1, None)[0]))
    assert sizes[1] < sizes[0]
