"""`heave sea`: the table behind docs/sea.md."""

from __future__ import annotations

import pytest

from experiments.cli import main
from experiments.sea import sea_table
from heave_env.scenarios import load


def test_the_thesis_filter_stands_beside_fitted_ones(capsys):
    assert main(["sea", "thesis_linear", "--orders", "4,6", "--horizons", "1,3"]) == 0
    printed = capsys.readouterr().out
    assert "boom tip under the true spectrum" in printed and "order 6" in printed
    thesis, _, six = sea_table(load("thesis_linear"), (4, 6), (1.0, 3.0))
    assert thesis[0] == "thesis" and thesis[1].variance == pytest.approx(-0.0625, abs=1e-3)
    assert thesis[3] == pytest.approx((9.29e-4, 0.107), rel=2e-3)
    assert abs(six[1].peak) < 0.01
    # The order moves what can be foreseen by more than an order of magnitude.
    assert six[3][0] > 20.0 * thesis[3][0]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["snap"], "a sea of the kind regular, which has no spectrum"),
        (["thesis_linear", "--orders", "5"], "filter_order must be even"),
        (["thesis_linear", "--orders", "four"], "take numbers separated by commas"),
        (["thesis_linear", "--orders", "4", "--horizons=-1"], "a horizon must not be negative"),
    ],
)
def test_nonsense_ends_in_a_sentence(arguments, sentence, capsys):
    assert main(["sea", *arguments]) == 2
    assert sentence in capsys.readouterr().err
