"""`heave operability`: scatter diagrams, verdicts under limits, a run that resumes, and its files."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import lognorm, weibull_min

from experiments import operability, runs
from experiments.cli import main
from experiments.compare import compare, controller_of
from experiments.limits import Limit, Seas, judged, limits_of, seas_needed, verdicts
from experiments.operability import CELLS, COLUMNS, PAGE_FILE, SUMMARY_FILE, TABLE_FILE, Survey
from experiments.rollout import FIRST_TEST_SEED, rollout
from experiments.scatter import SHIPPED, Cell, at_sea, check_sea, read_scatter, share
from heave_env.parameters import Draw
from heave_env.scenarios import load, to_mapping, with_value
from tests.experiments.test_compare import Page

HEADER = "significant_wave_height,peak_period,occurrence\n"
SMALL = HEADER + "1.0,7.0,60\n3.0,8.0,30\n6.0,10.0,10\n"


@pytest.fixture
def scatter(tmp_path) -> Path:
    path = tmp_path / "scatter.csv"
    path.write_text(SMALL, encoding="utf-8")
    return path


def asked(scatter: Path, out: Path, *more: str) -> list[str]:
    """A small command line: the linear payload in three classes, two seas of 20 s each."""
    return [
        "operability",
        "thesis_linear",
        *("--controllers", "none,lqg", "--scatter", str(scatter), "--limits", "payload_heave_std=0.1"),
        *("--seeds", "2", "--duration", "20", "--out", str(out), *more),
    ]


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def told(folder: Path) -> dict:
    return json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))


@pytest.fixture
def counted(monkeypatch):
    """How many rollouts were made."""
    made = []

    def counting(scenario, controller, seeds, **options):
        made.append(scenario.sea_state.significant_wave_height)
        return rollout(scenario, controller, seeds, **options)

    monkeypatch.setattr(operability, "rollout", counting)
    return made


@pytest.fixture
def unseen(monkeypatch):
    """Leaves the page blank, which takes most of the time of a small run."""
    monkeypatch.setattr("experiments.operability_page.page_text", lambda *arguments: "")


# The scatter diagram ------------------------------------------------------------------------------


def test_the_shipped_diagram_is_what_its_formula_says():
    found = {
        (cell.significant_wave_height, cell.peak_period): cell.occurrence
        for cell in read_scatter("synthetic_scatter.csv")
    }
    expected = {}
    for i in range(12):
        height = 0.5 + i
        of_height = np.diff(weibull_min.cdf([height - 0.5, height + 0.5], 1.4, scale=2.2))[0]
        periods = lognorm(0.2, scale=6.6 * height ** (1 / 3))
        for period in range(3, 22, 2):
            thousandths = 1e3 * of_height * (periods.cdf(period + 1) - periods.cdf(period - 1))
            if thousandths >= 0.5:
                expected[(height, float(period))] = round(thousandths)
    assert found == expected
    assert (SHIPPED / "synthetic_scatter.csv").read_text(encoding="utf-8").startswith("# Synthetic")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (HEADER + "1.0,7.0,nan\n", "line 2: occurrence is 'nan', which is no number"),
        (HEADER + "1.0,,3\n", "line 2: peak_period is '', which is no number"),
        (HEADER + "-1.0,7.0,3\n", "line 2: significant_wave_height must be positive, got -1"),
        (HEADER + "1.0,0.0,3\n", "line 2: peak_period must be positive"),
        (HEADER + "1.0,7.0,-3\n", "line 2: occurrence must be zero or more, got -3"),
        (HEADER + "1.0,7.0,3\n# two\n1.0,7.0,4\n", "line 4: Hs 1 m, Tp 7 s stands there twice"),
        (HEADER, "holds no sea that occurs"),
        (HEADER + "1.0,7.0,0\n", "holds no sea that occurs"),
        ("Hs,Tp,p\n1.0,7.0,3\n", "lacks the column 'significant_wave_height'"),
        ("", "lacks the column"),
    ],
)
def test_impossible_diagrams_are_refused_with_a_sentence(tmp_path, text, complaint):
    (tmp_path / "bad.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=complaint):
        read_scatter(tmp_path / "bad.csv")


def test_a_file_that_is_not_there_is_told():
    with pytest.raises(ValueError, match="cannot read scatter diagram 'nowhere.csv'"):
        read_scatter("nowhere.csv")


def test_classes_that_never_occur_are_left_out_and_shares_are_weighed(tmp_path):
    (tmp_path / "mine.csv").write_text(SMALL + "9.0,12.0,0\n", encoding="utf-8")
    cells = read_scatter(tmp_path / "mine.csv")
    assert len(cells) == 3
    assert share(cells, [True, False, True]) == pytest.approx(70.0)


def test_a_class_changes_the_sea_and_nothing_else():
    scenario = load("sea_state_5")
    there = at_sea(scenario, Cell(4.0, 10.0, 1.0))
    before, after = to_mapping(scenario), to_mapping(there)
    assert after["sea_state"].pop("significant_wave_height") == 4.0
    assert after["sea_state"].pop("peak_omega") == pytest.approx(2.0 * math.pi / 10.0)
    del before["sea_state"]["significant_wave_height"], before["sea_state"]["peak_omega"]
    assert after == before


@pytest.mark.parametrize(
    ("path", "value", "complaint"),
    [
        ("sea_state.kind", "regular", "has a regular sea, which has no spectrum"),
        ("sea_state.kind", "calm", "has a calm sea"),
        ("sea_state.spectrum", "pierson_moskowitz", "wave height and peak period do not describe"),
    ],
)
def test_a_sea_that_a_diagram_cannot_set_is_refused(path, value, complaint):
    scenario = with_value(load("thesis_linear"), "sea_state.kind", "random_phase")
    scenario = with_value(scenario, "sea_state.peak_omega", 1.0)
    with pytest.raises(ValueError, match=complaint):
        check_sea(with_value(scenario, path, value))


def test_a_sea_that_draws_its_own_height_is_refused():
    draws = (Draw(parameter="sea_state.significant_wave_height", low=2.0, high=4.0),)
    with pytest.raises(ValueError, match="which the scatter diagram gives"):
        check_sea(dataclasses.replace(load("thesis_linear"), uncertainty=draws))


# Limits -------------------------------------------------------------------------------------------


def test_limits_are_read_and_some_metrics_are_bounded_below():
    limits = limits_of(" payload_heave_std = 0.1, tension_min=1e3,slack_fraction=0", load("sea_state_5"))
    assert [(limit.metric, limit.bound, limit.at_least) for limit in limits] == [
        ("payload_heave_std", 0.1, False),
        ("tension_min", 1000.0, True),
        ("slack_fraction", 0.0, False),
    ]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "no limit was given"),
        ("payload_heave_std", "METRIC=VALUE"),
        ("payload_heave_sdt=1", "did you mean 'payload_heave_std'"),
        ("swell=1", "metrics: payload_heave_std, .*saturation_fraction"),
        ("tension_peak=2e5", "scenario 'thesis_linear' has no cable"),
        ("efficiency_locked_winch=0.5", "no limit can be set"),
        ("payload_heave_std=0.1,payload_heave_std=0.2", "given twice"),
        ("payload_heave_std=deep", "must be a number that can be kept, got 'deep'"),
        ("payload_heave_std=nan", "must be a number"),
        ("payload_heave_std=-1", "must be a number that can be kept"),
    ],
)
def test_impossible_limits_are_refused_with_a_sentence(text, complaint):
    with pytest.raises(ValueError, match=complaint):
        limits_of(text, load("thesis_linear"))


def seas(values, failed=None, metric="payload_heave_std") -> Seas:
    values = np.asarray(values, dtype=float)
    return Seas({metric: values}, np.zeros(len(values), bool) if failed is None else np.asarray(failed))


def test_the_mean_and_its_interval_are_student_s():
    found = judged(seas([1.0, 2.0, 3.0]), "payload_heave_std")
    half = 4.302653 / math.sqrt(3.0)  # t of two degrees of freedom, 97.5 %
    assert (found.value, found.worst, found.n_seas) == (2.0, 3.0, 3)
    assert (found.low, found.high) == pytest.approx((2.0 - half, 2.0 + half), rel=1e-6)


def test_one_sea_decides_nothing():
    row = [seas([1.0])]
    found = verdicts(row, [Limit("payload_heave_std", 2.0)])
    assert (found.operable[0], found.surely[0], found.perhaps[0]) == (True, False, True)


def test_a_failed_sea_keeps_no_limit_but_a_quantile_forgives_few():
    limits = [Limit("payload_heave_std", 2.0)]
    row = [seas(np.ones(20), np.arange(20) == 3)]
    assert not verdicts(row, limits).perhaps[0]
    assert verdicts(row, limits, 0.95).operable[0]
    assert not verdicts(row, limits, 0.96).operable[0]


def test_a_sea_without_a_score_does_not_count_and_none_is_not_operable():
    assert judged(seas([1.0, math.nan, 3.0]), "payload_heave_std").n_seas == 2
    found = verdicts([seas([math.nan])], [Limit("payload_heave_std", 2.0)])
    assert not found.operable[0]
    assert not found.perhaps[0]


def test_of_some_metrics_more_is_better():
    row = seas([5.0, 6.0, 7.0], [False, False, False], "tension_min")
    assert judged(row, "tension_min", 0.9).value == 5.0  # nine in ten seas have at least this
    assert judged(row, "tension_min").worst == 5.0
    assert verdicts([row], [Limit("tension_min", 5.5)]).operable[0]
    assert not verdicts([row], [Limit("tension_min", 6.5)]).operable[0]
    broken = seas([5.0, 6.0, 7.0], [False, True, False], "tension_min")
    assert not verdicts([broken], [Limit("tension_min", 0.0)]).operable[0]


def test_the_interval_of_a_quantile_covers_it():
    """Of samples of 100 the interval of the 80 % quantile covers the true one in 95 % at least (3 errors)."""
    rng = np.random.default_rng(5)
    true = -math.log(0.2)
    hits = []
    for row in rng.exponential(size=(400, 100)):
        found = judged(seas(row), "payload_heave_std", 0.8)
        hits.append(found.low <= true <= found.high)
    assert np.mean(hits) >= 0.95 - 3.0 * math.sqrt(0.95 * 0.05 / 400)


def test_a_quantile_asks_for_enough_seas():
    """The largest of n values bounds the quantile q with 97.5 % if q^n is at most 2.5 %."""
    for quantile in (0.5, 0.9, 0.95):
        assert seas_needed(quantile) == math.ceil(math.log(0.025) / math.log(quantile))
    assert seas_needed(None) == 2


@settings(deadline=None, derandomize=True, max_examples=40)
@given(
    values=st.lists(st.floats(0.0, 1e3), min_size=1, max_size=40),
    bound=st.floats(0.0, 1e3),
    quantile=st.floats(0.01, 0.99),
)
def test_a_quantile_keeps_its_limit_exactly_if_that_share_of_the_seas_does(values, bound, quantile):
    row, limit = seas(values), Limit("payload_heave_std", bound)
    kept = np.mean(np.array(values) <= bound)
    found = judged(row, "payload_heave_std", quantile)
    assert found.low <= found.value <= found.high
    if abs(kept - quantile) > 1e-6:
        assert found.kept(limit) == (kept > quantile)


# The run ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("operability")
    (path / "scatter.csv").write_text(SMALL, encoding="utf-8")
    assert main(asked(path / "scatter.csv", path / "out")) == 0
    return path / "out"


def test_the_folder_holds_every_file_and_nothing_half_written(folder):
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    classes = ("hs_1.0_tp_7.0", "hs_3.0_tp_8.0", "hs_6.0_tp_10.0")
    kept = {f"{CELLS}/{label}/{name}.json" for label in ("none", "lqg") for name in classes}
    assert files == {"run.json", TABLE_FILE, SUMMARY_FILE, PAGE_FILE} | kept


def test_percentages_follow_from_the_table(folder):
    rows, found = table(folder / TABLE_FILE), told(folder)
    assert tuple(rows[0]) == COLUMNS
    assert len({(r["controller"], r["significant_wave_height"], r["metric"]) for r in rows}) == len(rows)
    for label, item in found["controllers"].items():
        mine = [r for r in rows if r["controller"] == label and r["metric"] == "payload_heave_std"]
        assert [r["kept"] for r in mine] == [r["operable"] for r in mine]
        for r in mine:
            assert r["kept"] == str(int(float(r["value"]) <= 0.1))
        operable = sum(float(r["occurrence"]) for r in mine if r["operable"] == "1")
        assert item["operable"] == pytest.approx(operable)  # occurrences add up to 100
        assert item["low"] <= item["operable"] <= item["high"]
    assert found["controllers"]["none"]["operable"] < found["controllers"]["lqg"]["operable"] == 100.0


def test_a_class_is_what_a_comparison_in_that_sea_finds(folder, tmp_path):
    """The class that is the scenario's own sea: the same seas, scores and controllers as heave compare."""
    scenario = at_sea(load("thesis_linear"), Cell(3.0, 8.0, 1.0))
    out = compare([scenario], ["none"], n_seeds=2, out=tmp_path / "one", duration=20.0)
    known = {row["metric"]: row["value"] for row in table(out / "results.csv")}
    mine = [
        row
        for row in table(folder / TABLE_FILE)
        if row["controller"] == "none" and row["significant_wave_height"] == "3.0"
    ]
    assert {row["metric"] for row in mine} >= {"payload_heave_std", "payload_heave_max", "control_energy"}
    for row in mine:
        assert float(row["value"]) == pytest.approx(float(known[row["metric"]]), rel=1e-12)


def surveyed(scenario, spec, cell, design="fixed", **changed):
    plan = Survey(scenario, [cell], (spec,), range(FIRST_TEST_SEED, FIRST_TEST_SEED + 2), design, 20.0, "s")
    return plan.run(*plan.acting(spec, cell, plan.prepared(spec)), lambda count: None)


def test_a_fixed_controller_measures_the_same_in_every_sea():
    """It must not read the scales that the observation would have in the class's own sea: it does what the
    design does when its units are those of that sea."""
    from baselines.linear_controller import observation_units

    scenario, cell = load("thesis_linear"), Cell(6.0, 10.0, 1.0)
    found = surveyed(scenario, "lqg", cell)
    there = dataclasses.replace(at_sea(scenario, cell), duration=20.0)
    lqg = controller_of("lqg", scenario)
    scale, offset = observation_units(there, lqg.measures)
    assert not np.allclose(scale, lqg.scale)
    adapted = dataclasses.replace(lqg, scale=scale, offset=offset)
    heave = rollout(there, adapted, [FIRST_TEST_SEED]).states["payload_heave"][51:, 0]
    # Observations are single precision, and rounded in other units.
    assert found.values["payload_heave_std"][0] == pytest.approx(heave.std(), rel=1e-4)


def test_a_controller_of_each_sea_is_the_fixed_one_in_its_own_sea_and_better_elsewhere():
    scenario = load("thesis_linear")
    own = Cell(scenario.sea_state.significant_wave_height, 2.0 * math.pi / 0.785, 1.0)
    for metric in ("cost", "payload_heave_std"):
        fixed, each = (surveyed(scenario, "lqg", own, how).values[metric] for how in ("fixed", "each"))
        assert fixed == pytest.approx(each, rel=1e-6)
    short = Cell(1.0, 4.0, 1.0)
    fixed, each = (surveyed(scenario, "lqg", short, how).values["cost"].mean() for how in ("fixed", "each"))
    assert each < fixed


def test_a_controller_that_reads_the_sea_s_filter_needs_a_design_for_each_sea():
    scenario = with_value(load("thesis_linear"), "information_set", "full_state")
    with pytest.raises(ValueError, match="mean something else in every sea; .* --design each"):
        surveyed(scenario, "lqg", Cell(3.0, 8.0, 1.0))
    assert surveyed(scenario, "lqg", Cell(3.0, 8.0, 1.0), "each").values["payload_heave_std"].max() < 0.1


def test_an_agent_acts_as_it_is_and_a_changed_policy_is_run_again(scatter, tmp_path, counted, unseen):
    from agents.policy import Architecture, TrainedPolicy, policy_card, save_policy

    scenario = load("thesis_linear")
    n = len(scenario.observation_names)
    layers = Architecture(n_observations=n, feature_bound=5.0, hidden=(2,), activation="tanh", output="clip")

    def save(gain: float) -> None:
        weights = {name: np.zeros(shape, dtype=np.float32) for name, shape in layers.shapes.items()}
        weights["output.bias"] += np.float32(gain)
        card = policy_card(scenario, algorithm="ppo")
        save_policy(tmp_path / "run" / "policy.json", TrainedPolicy(layers, weights, card))

    (tmp_path / "run").mkdir()
    save(0.1)
    line = asked(scatter, tmp_path / "out", "--controllers", f"agent:{tmp_path / 'run'}")
    assert main(line) == main(line) == 0
    assert len(counted) == 3
    rows = [row for row in table(tmp_path / "out" / TABLE_FILE) if row["metric"] == "control_energy"]
    command = 0.1 * scenario.winch.command_range
    assert [float(row["value"]) for row in rows] == pytest.approx([command**2] * 3, rel=1e-6)
    save(0.2)
    assert main(line) == 0
    assert len(counted) == 6


def test_what_is_finished_is_not_run_again_whatever_the_limits(scatter, tmp_path, counted, unseen):
    out = tmp_path / "out"
    main(asked(scatter, out))
    assert len(counted) == 6
    main(asked(scatter, out, "--limits", "payload_heave_max=0.3", "--quantile", "0.5"))
    assert len(counted) == 6
    assert told(out)["statistic"] == "quantile 0.5"
    main(asked(scatter, out, "--controllers", "none,lqr"))
    assert len(counted) == 9  # the new controller alone
    scatter.write_text(SMALL + "4.0,9.0,5\n", encoding="utf-8")
    main(asked(scatter, out))
    assert counted[9:] == [4.0, 4.0]  # the new class alone
    main(asked(scatter, out, "--seeds", "3"))
    assert len(counted) == 11 + 8


@pytest.mark.parametrize("change", ["source", "scenario", "design", "damage"])
def test_what_was_made_otherwise_is_run_again(scatter, tmp_path, counted, unseen, monkeypatch, change):
    out, more = tmp_path / "out", []
    main(asked(scatter, out))
    if change == "source":
        monkeypatch.setattr(operability, "source_hash", lambda: "another")
    elif change == "damage":
        for path in out.rglob("hs_*.json"):
            path.write_text(path.read_text(encoding="utf-8")[:50], encoding="utf-8")
    else:
        more = {"scenario": ["--set", "winch.time_constant=2.0"], "design": ["--design", "each"]}[change]
    main(asked(scatter, out, *more))
    assert len(counted) == (9 if change == "design" else 12)  # without control there is no design


def test_an_interrupted_run_goes_on_where_it_was(scatter, tmp_path, unseen, monkeypatch, capsys):
    made = []

    def interrupted(*arguments, **options):
        if len(made) == 4:
            raise KeyboardInterrupt
        made.append(arguments)
        return rollout(*arguments, **options)

    out = tmp_path / "out"
    monkeypatch.setattr(operability, "rollout", interrupted)
    assert main(asked(scatter, out)) == 130
    assert "the same command goes on from there" in capsys.readouterr().err
    assert not (out / TABLE_FILE).exists()
    whole = list(out.rglob("hs_*.json"))
    assert len(whole) == 4
    made.clear()
    assert main(asked(scatter, out)) == 0
    assert len(made) == 2
    again = tmp_path / "again"
    made.clear()
    monkeypatch.setattr(operability, "rollout", rollout)
    main(asked(scatter, again))
    assert (out / TABLE_FILE).read_bytes() == (again / TABLE_FILE).read_bytes()


def test_a_lost_payload_is_counted_and_closes_the_class(scatter, tmp_path):
    scenario = with_value(load("deep_resonance"), "cable.breaking_strength", 230_000.0)
    found = operability.operability(
        scenario,
        ["none"],
        limits="payload_heave_std=1e6",
        n_seeds=2,
        out=tmp_path / "out",
        scatter=scatter,
        duration=40.0,
    )
    rows = [row for row in table(found / TABLE_FILE) if row["metric"] == "payload_heave_std"]
    lost = [row for row in rows if row["failed"] != "0"]
    assert lost
    assert {(row["operable"], row["value"]) for row in lost} == {("0", "")}
    assert told(found)["controllers"]["none"]["n_failed"] == sum(int(row["failed"]) for row in rows)


# The page and the terminal ------------------------------------------------------------------------


def test_the_page_is_self_contained_and_has_a_map_of_each(folder):
    text = (folder / PAGE_FILE).read_text(encoding="utf-8")
    page = Page(text)
    assert all(item.startswith(("data:", "#")) for item in page.references)
    assert "http" not in text.replace("data:image/svg+xml", "")
    assert "<script" not in text
    assert len(page.images) == 1 + 4  # where operable, and the four maps of a plant without a cable
    assert "payload_heave_std ≤ 0.1 m" in text
    assert not [cell for cell in page.cells if cell.strip().lower() in ("nan", "none", "inf", "")]


def test_the_terminal_tells_the_percentages(scatter, tmp_path, unseen, capsys):
    main(asked(scatter, tmp_path / "out"))
    said = capsys.readouterr().out
    assert "operable [%]" in said
    assert "3 of 3" in said
    assert "3 classes of" in said
    assert "at least" not in said
    main(asked(scatter, tmp_path / "out", "--quantile", "0.9"))
    assert "With 2 seas per class none is surely operable by the quantile 0.9" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "complaint"),
    [
        (("--limits", "payload_heave_sdt=1"), "did you mean 'payload_heave_std'"),
        (("--scatter", "nowhere.csv"), "cannot read scatter diagram"),
        (("--controllers", "kalman"), "unknown controller 'kalman'"),
        (("--seeds", "0"), "seeds must be at least 1"),
        (("--quantile", "1.5"), "quantile must lie between 0 and 1"),
        (("--duration", "3.33"), "whole number of control steps"),
        (("--set", "sea_state.kind=calm"), "no spectrum"),
        (("--controllers", "agent:OUT"), "there is no run"),
    ],
)
def test_a_wrong_command_is_refused_in_one_sentence(scatter, tmp_path, capsys, more, complaint):
    out = tmp_path / "out"
    assert main(asked(scatter, out, *(item.replace("OUT", str(out)) for item in more))) == 2
    said = capsys.readouterr().err
    assert said.startswith("heave: ")
    assert said.count("\n") == 1
    assert complaint in said
    assert not out.exists()


def test_another_run_s_folder_is_left_alone(scatter, tmp_path, capsys):
    runs.write_json(tmp_path / "out" / "run.json", {"kind": runs.COMPARISON})
    assert main(asked(scatter, tmp_path / "out")) == 2
    assert "another kind of run (comparison)" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["run.json"]
