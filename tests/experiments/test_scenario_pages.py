"""The scenarios' pages: one for each, of today's numbers, written the same way twice."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from experiments.cli import main
from experiments.scenario_pages import NOTES, natural_frequencies, peak_of, variant_rows, write_page
from heave_env.cable.closed_form import resonant_length
from heave_env.scenarios import load, names, variants_of

PAGES = Path(__file__).resolve().parents[2] / "docs" / "scenarios"


def test_every_named_scenario_has_its_note():
    assert set(NOTES) == set(names())
    for note in NOTES.values():
        assert note.tier and len(note.purpose) > 30 and note.sources


@pytest.mark.parametrize("name", names())
def test_every_page_is_of_today_s_scenario(name):
    # Where this fails: heave scenarios page NAME, and look at the picture.
    text = (PAGES / f"{name}.md").read_text(encoding="utf-8")
    assert f"Fingerprint `{load(name).fingerprint}`" in text
    assert set(re.findall(r"\| `@(\w+)` \|", text)) == set(variants_of(load(name)))
    assert (PAGES / f"{name}.png").stat().st_size > 5_000


def test_the_pages_are_small_and_of_nothing_else():
    files = sorted(PAGES.iterdir())
    assert {path.stem for path in files} == set(names())
    assert sum(path.stat().st_size for path in files) < 3_000_000


def test_the_index_leads_to_every_page():
    index = (PAGES.parent / "scenarios.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\(scenarios/(\w+)\.md\)", index)) == set(names())


def test_a_page_is_written_the_same_way_twice(tmp_path, capsys):
    arguments = ["scenarios", "page", "thesis_linear", "--seeds", "2", "--duration", "20"]
    arguments += ["--controllers", "none,lqg,multi_model,feedforward"]
    for folder in ("one", "two"):
        assert main([*arguments, "--out", str(tmp_path / folder)]) == 0
    one, two = (tmp_path / folder for folder in ("one", "two"))
    for file in ("thesis_linear.md", "thesis_linear.png"):
        assert (one / file).read_bytes() == (two / file).read_bytes()
    text = (one / "thesis_linear.md").read_text(encoding="utf-8")
    assert "| `lqg` |" in text and "Not designed: `feedforward`" in text
    # The best acts on the variants; numbers stand in every column.
    row = next(line for line in text.splitlines() if line.startswith("| `@rougher`"))
    numbers = [float(cell.replace(" ", "")) for cell in row.split("|")[2:-1]]
    assert len(numbers) == 5 and all(np.isfinite(numbers)) and numbers[1] < numbers[0]
    capsys.readouterr()


def test_recovery_crosses_resonance_while_it_hauls():
    scenario = load("recovery")
    low, high = natural_frequencies(scenario)
    peak = peak_of(scenario)
    assert low < peak < high
    meets = float(resonant_length(np.array([peak]), scenario.cable, scenario.payload)[0])
    plan = scenario.pay_out
    when = plan.start + 0.5 * plan.ramp + (scenario.length - meets) / abs(plan.speed)
    # As its description says.
    assert meets == pytest.approx(1180.0, abs=5.0) and when == pytest.approx(200.0, abs=10.0)
    # The thesis's lowering ends before that.
    assert peak_of(load("lowering")) < min(natural_frequencies(load("lowering")))


def test_the_list_knows_which_scenario_lacks_a_variant():
    for variant, told, lacking in variant_rows():
        assert told.endswith(".")
        for name in ("snap", "thesis_cable", "unknown_linear"):
            assert (name in lacking.split(", ")) == (variant.removeprefix("@") not in variants_of(load(name)))


def test_a_page_of_nobody_is_refused(tmp_path):
    with pytest.raises(ValueError, match="unknown scenario 'thesis_liner'; did you mean"):
        write_page("thesis_liner", tmp_path, n_seeds=1)
