"""A comparison's files: their columns, seeds and numbers, and the page drawn from them."""

from __future__ import annotations

import csv
import json
import math
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from baselines.bound import causal_bound
from experiments import report, runs
from experiments.compare import (
    check_specs,
    compare,
    controller_of,
    default_reference,
    labels_of,
    oracle_labels,
)
from experiments.metrics import METRICS, metric_names
from experiments.results import RESULT_COLUMNS
from experiments.rollout import FIRST_TEST_SEED, rollout
from heave_env.scenarios import from_mapping, load, with_value
from tests.experiments.stored import comparison

FILES = {"results.csv", "results.json", "episodes.csv", "trajectories.npz", "run.json", "report.html", "kept"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two scenarios, three controllers, three seas of 40 s."""
    return compare(
        [load("thesis_linear"), load("sea_state_5")],
        ["none", "lqr", "lqg"],
        n_seeds=3,
        out=tmp_path_factory.mktemp("runs") / "comparison",
        duration=40.0,
        arguments=["compare", "thesis_linear"],
    )


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def value(rows, scenario, controller, metric):
    (row,) = (
        r for r in rows if (r["scenario"], r["controller"], r["metric"]) == (scenario, controller, metric)
    )
    return float(row["value"])


def test_the_folder_holds_every_file_and_nothing_half_written(folder):
    assert {path.name for path in folder.iterdir()} == FILES


def test_results_are_tidy(folder):
    rows = rows_of(folder / "results.csv")
    assert tuple(rows[0]) == RESULT_COLUMNS
    keys = [(row["scenario"], row["controller"], row["metric"]) for row in rows]
    assert len(set(keys)) == len(keys)
    for row in rows:
        assert math.isfinite(float(row["value"]))
        assert row["n_seas"] == "3"
        assert row["unit"]
        if row["low"]:
            assert float(row["low"]) <= float(row["value"]) <= float(row["high"])
    found = {row["metric"] for row in rows if row["scenario"] == "sea_state_5"}
    assert set(metric_names(load("sea_state_5"))) <= found
    assert {"energy_index", "cost_difference", "payload_heave_std_median", "diverged"} <= found


def test_metrics_of_tension_are_left_out_where_there_is_none(folder):
    found = {row["metric"] for row in rows_of(folder / "results.csv") if row["scenario"] == "thesis_linear"}
    assert not found & {name for name, metric in METRICS.items() if metric.cable}


def test_the_proven_optimum_is_compared_where_there_is_one(folder):
    rows = rows_of(folder / "results.csv")
    ratio = value(rows, "thesis_linear", "none", "cost_ratio_to_optimum")
    summary = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    optimum = summary["scenarios"]["thesis_linear"]["controllers"]["none"]["optimal_cost"]
    assert ratio == pytest.approx(value(rows, "thesis_linear", "none", "cost") / optimum)
    assert not any(r["metric"] == "cost_ratio_to_optimum" for r in rows if r["scenario"] == "sea_state_5")


def test_the_causal_bound_and_the_time_of_a_decision_are_metrics_of_their_own(folder):
    rows = rows_of(folder / "results.csv")
    for name, outputs in (("thesis_linear", ("payload", "sheave")), ("sea_state_5", ("sheave",))):
        bound = causal_bound(load(name))
        assert bound is not None
        for controller in ("none", "lqr", "lqg"):
            for output in outputs:
                least = value(rows, name, controller, f"{output}_heave_std_bound")
                assert least == getattr(bound, f"{output}_heave_std")
                assert least < value(rows, name, controller, f"{output}_heave_std")
            assert 0.0 < value(rows, name, controller, "decision_time") < 1e5
    # The payload below a cable is not linear: no bound is claimed for it.
    assert not any(r["metric"] == "payload_heave_std_bound" for r in rows if r["scenario"] == "sea_state_5")
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "causal bound, sheave std" in page
    assert "µs per decision" in page


def test_the_clairvoyant_yardstick_is_below_everybody_and_asked_for(tmp_path):
    short = dict(n_seeds=2, duration=40.0, arguments=["compare"], clairvoyant=True)
    folder = compare([load("limits_linear")], ["none", "feedforward"], out=tmp_path / "out", **short)
    rows = rows_of(folder / "results.csv")
    least = value(rows, "limits_linear", "clairvoyant", "cost")
    assert 0.0 < least < value(rows, "limits_linear", "feedforward", "cost")
    assert "clairvoyant J" in (folder / "report.html").read_text(encoding="utf-8")
    with pytest.raises(ValueError, match="takes a linear payload, scenario 'sea_state_5' has a cable"):
        compare([load("sea_state_5")], ["none"], out=tmp_path / "other", **short)
    assert not (tmp_path / "other").exists()


def test_the_oracle_is_a_yardstick_and_every_cost_is_given_over_its_own(tmp_path):
    short = dict(n_seeds=2, duration=20.0, arguments=["compare"], oracle=True)
    seen: set[str] = set()
    folder = compare(
        [load("unknown_linear")],
        ["none", "feedforward"],
        out=tmp_path / "out",
        progress=lambda scenario, label, count, total: seen.add(label),
        **short,
    )
    rows, episodes = rows_of(folder / "results.csv"), rows_of(folder / "episodes.csv")
    name = "unknown_linear"
    assert 0.0 < value(rows, name, "oracle", "cost") < value(rows, name, "none", "cost")
    assert not any(row["controller"] == "oracle" for row in episodes)
    ratios = [float(row["cost_over_oracle [-]"]) for row in episodes if row["controller"] == "none"]
    assert value(rows, name, "none", "cost_over_oracle") == pytest.approx(np.mean(ratios))
    assert value(rows, name, "none", "cost_over_oracle_maximum") == pytest.approx(max(ratios))
    assert min(ratios) > 1.0
    assert {"oracle", "oracle designs"} <= seen
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "yardstick oracle, J" in page and "What not knowing the parameters costs" in page
    with pytest.raises(ValueError, match="'thesis_linear' has no uncertainty; leave --oracle out"):
        compare([load("thesis_linear")], ["none"], out=tmp_path / "other", **short)


def test_where_limits_bite_the_oracle_plans():
    assert oracle_labels(load("limits_unknown_linear")) == ("oracle", "oracle_mpc")
    assert oracle_labels(load("unknown_linear")) == ("oracle",)


def test_the_seas_are_the_first_test_seas(folder):
    rows = rows_of(folder / "episodes.csv")
    assert {int(row["seed"]) for row in rows} == set(range(FIRST_TEST_SEED, FIRST_TEST_SEED + 3))
    assert len(rows) == 2 * 3 * 3
    assert FIRST_TEST_SEED == 20_000_000


def test_results_are_the_means_of_the_episodes(folder):
    episodes = rows_of(folder / "episodes.csv")
    rows = rows_of(folder / "results.csv")
    heave = [
        float(row["payload_heave_std [m]"])
        for row in episodes
        if (row["scenario"], row["controller"]) == ("sea_state_5", "lqg")
    ]
    assert value(rows, "sea_state_5", "lqg", "payload_heave_std") == pytest.approx(np.mean(heave))
    locked = [float(row["efficiency_locked_winch [-]"]) for row in episodes if row["controller"] == "none"]
    assert locked == [0.0] * 6


def test_differences_are_paired_with_the_reference(folder):
    episodes = rows_of(folder / "episodes.csv")

    def cost(label):
        return np.array(
            [
                float(row["cost [-]"])
                for row in episodes
                if (row["scenario"], row["controller"]) == ("thesis_linear", label)
            ]
        )

    rows = rows_of(folder / "results.csv")
    expected = np.mean(cost("none") - cost("lqg"))
    assert value(rows, "thesis_linear", "none", "cost_difference") == pytest.approx(expected)
    assert not any(r["controller"] == "lqg" and r["metric"] == "cost_difference" for r in rows)


def test_json_is_strict_and_names_its_origin(folder):
    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    for name in ("run.json", "results.json"):
        content = json.loads((folder / name).read_text(encoding="utf-8"), parse_constant=refuse)
        made = content["provenance"]
        assert {"command", "date", "commit", "versions"} <= set(made)
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert (run["kind"], run["first_seed"], run["n_seeds"]) == ("comparison", FIRST_TEST_SEED, 3)
    stored = run["scenarios"][1]
    assert from_mapping(stored["scenario"]).fingerprint == stored["fingerprint"]


def test_stored_series_are_those_of_the_rollout(folder):
    arrays = runs.read_arrays(folder / "trajectories.npz")
    scenario = load("sea_state_5")
    again = rollout(scenario, controller_of("lqg", scenario), [FIRST_TEST_SEED], duration=40.0)
    series = arrays["sea_state_5/lqg/payload_heave"][:, 0]
    assert np.array_equal(series, again.states["payload_heave"][:, 0].astype(np.float32))
    assert arrays["sea_state_5/time"][-1] == 40.0


def test_a_short_episode_is_scored_after_a_quarter(folder):
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert [(item["warm_up"], item["scored"]) for item in run["scenarios"]] == [(10.0, 30.0)] * 2


def test_the_locked_winch_runs_even_when_it_is_not_asked_for(tmp_path):
    out = compare([load("thesis_linear")], ["lqg"], n_seeds=2, out=tmp_path, duration=20.0)
    rows = rows_of(out / "results.csv")
    assert {row["controller"] for row in rows} == {"lqg"}
    assert value(rows, "thesis_linear", "lqg", "efficiency_locked_winch") > 0.5


def test_a_lost_payload_is_counted_and_charged(tmp_path):
    scenario = with_value(load("snap"), "cable.breaking_strength", 20_000.0)
    out = compare([scenario], ["none"], n_seeds=2, out=tmp_path, duration=30.0)
    rows = rows_of(out / "results.csv")
    assert value(rows, "snap", "none", "lost") == 2
    assert value(rows, "snap", "none", "cost") > 1e3
    assert "2 lost" in (out / "report.html").read_text(encoding="utf-8")


# Asked for wrongly -------------------------------------------------------------------------------


def test_labels_are_short_and_distinct(tmp_path):
    runs_of = [tmp_path / part for part in ("a/ppo", "b/ppo", "b/sac")]
    specs = ["none", *(f"agent:{run}" for run in runs_of)]
    labels = labels_of(specs)
    assert labels["none"] == "none"
    assert labels[specs[3]] == "agent:sac"
    assert labels[specs[1]] == specs[1]
    assert len(set(labels.values())) == 4


def test_the_reference_is_lqg_where_it_takes_part():
    assert default_reference(["none", "lqg"]) == "lqg"
    assert default_reference(["lqr", "none"]) == "lqr"


@pytest.mark.parametrize(
    ("specs", "complaint"),
    [
        ([], "no controller"),
        (["lqgg"], "did you mean 'lqg'"),
        (["none", "none"], "twice"),
        (["agent:"], "run folder"),
        (["agent:/nowhere/at/all"], "there is no run"),
    ],
)
def test_impossible_controllers_are_refused(specs, complaint):
    with pytest.raises(ValueError, match=complaint):
        check_specs(specs)


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"n_seeds": 0}, "at least 1"),
        ({"reference": "pid"}, "not among the controllers"),
        ({"duration": 3.33}, "whole number of control steps"),
        ({"warm_up": 50.0}, "warm-up"),
        ({"scenarios": [load("snap"), load("snap")]}, "twice"),
        ({"scenarios": []}, "no scenario"),
    ],
)
def test_impossible_comparisons_write_nothing(tmp_path, changed, complaint):
    arguments = {
        "scenarios": [load("thesis_linear")],
        "controllers": ["none"],
        "n_seeds": 1,
        "duration": 20.0,
        "out": tmp_path / "out",
    } | changed
    with pytest.raises(ValueError, match=complaint):
        compare(arguments.pop("scenarios"), arguments.pop("controllers"), **arguments)
    assert not (tmp_path / "out").exists()


def test_a_training_run_is_not_overwritten(tmp_path):
    (tmp_path / "run.json").write_text('{"algorithm": "ppo"}', encoding="utf-8")
    with pytest.raises(ValueError, match="another kind of run"):
        compare([load("thesis_linear")], ["none"], n_seeds=1, out=tmp_path, duration=20.0)
    assert (tmp_path / "run.json").read_text(encoding="utf-8") == '{"algorithm": "ppo"}'


# The page ----------------------------------------------------------------------------------------


class Page(HTMLParser):
    """Collects what a page refers to, its images and its tables' cells."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.references, self.images, self.open = [], [], []
        self.cells = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.references += [found[key] for key in ("src", "href", "data", "action") if key in found]
        if tag == "img":
            self.images.append(found["src"])
        self.open.append(tag)

    def handle_endtag(self, tag):
        while self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "small"):
            self.cells.append(data)


@pytest.fixture(scope="module")
def page(folder):
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def test_the_page_is_self_contained(folder, page):
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert all(item.startswith(("data:", "#")) for item in page.references)
    assert "http" not in text.replace("data:image/svg+xml", "")
    assert "<script" not in text
    assert "@import" not in text


def test_the_page_shows_four_figures_of_each_scenario(page):
    assert len(page.images) == 8
    assert all(image.startswith("data:image/svg+xml;base64,") for image in page.images)


def test_what_a_controller_sees_and_the_delay_stand_beside_every_result(page):
    beside = [cell for cell in page.cells if "delay" in cell]
    assert len(beside) == 3 * 2 + 3 * 3  # a linear plant has two tables, a cable three
    assert beside.count("sensors · delay 0.2 s") == 9


def test_the_page_has_no_number_that_is_none_or_nan(page):
    assert not [cell for cell in page.cells if cell.strip().lower() in ("nan", "none", "inf", "")]


def test_a_page_is_redrawn_without_simulating(folder, monkeypatch):
    def refuse(*arguments, **options):
        raise AssertionError("a report simulates nothing")

    monkeypatch.setattr("experiments.compare.rollout", refuse)
    monkeypatch.setattr("heave_env.env.HeaveVectorEnv.__init__", refuse)
    before = (folder / "report.html").read_text(encoding="utf-8")
    (folder / "report.html").unlink()
    assert report.write_report(folder).read_text(encoding="utf-8") == before


def test_a_made_up_comparison_is_reported(tmp_path):
    text = report.write_report(comparison(tmp_path)).read_text(encoding="utf-8")
    assert "agent:ppo" in text
    assert "sensors history" in text


def test_broken_folders_are_refused_with_a_sentence(tmp_path):
    with pytest.raises(ValueError, match="holds no comparison"):
        report.write_report(tmp_path)
    comparison(tmp_path)
    (tmp_path / "trajectories.npz").write_bytes(b"PK not a zip")
    with pytest.raises(ValueError, match="cannot read arrays"):
        report.write_report(tmp_path)
    assert not (tmp_path / "report.html").exists()
    comparison(tmp_path)
    (tmp_path / "results.json").write_text('{"scenarios": {}}', encoding="utf-8")
    with pytest.raises(ValueError, match="incomplete"):
        report.write_report(tmp_path)


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (0.0, "0"),
        (4.3e-46, "0"),
        (1234.5, "1 230"),
        (0.0123456, "0.0123"),
        (2.96e-4, "2.96·10⁻⁴"),
        (-3.0, "−3.00"),
        (999.9, "1 000"),
        (None, "–"),
        (math.nan, "–"),
    ],
)
def test_numbers_are_shown_to_three_digits(number, text):
    assert report.significant(number).replace("\N{NARROW NO-BREAK SPACE}", " ") == text


@pytest.mark.parametrize(
    ("mean", "half", "text"),
    [
        (2.6664, 0.0862, "2.666 ± 0.086"),
        (96.99902, 6.7e-4, "96.999 ± 0.001"),
        (159876.0, 15700.0, "160 000 ± 16 000"),
    ],
)
def test_an_interval_sets_the_digits_of_its_mean(mean, half, text):
    shown = report.with_interval({"mean": mean, "low": mean - half, "high": mean + half})
    assert shown.replace("\N{NARROW NO-BREAK SPACE}", " ") == text


# Interrupted -------------------------------------------------------------------------------------


def test_an_interrupted_comparison_goes_on_where_it_was(tmp_path, monkeypatch):
    given = dict(n_seeds=2, duration=20.0, arguments=["compare"], oracle=True)
    names, labels = [load("unknown_linear")], ["none", "feedforward", "lqg"]
    whole = compare(names, labels, out=tmp_path / "whole", **given)

    def stop(scenario, label, count, total):
        if label == "lqg":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compare(names, labels, out=tmp_path / "cut", progress=stop, **given)
    assert [path.name for path in (tmp_path / "cut").iterdir()] == ["kept"]

    acted = []

    def noted(scenario, controller, seeds, **options):
        acted.append(getattr(controller, "name", "?"))
        return rollout(scenario, controller, seeds, **options)

    monkeypatch.setattr("experiments.compare.rollout", noted)
    cut = compare(names, labels, out=tmp_path / "cut", **given)
    assert acted == ["lqg", "oracle"]
    assert (cut / "episodes.csv").read_bytes() == (whole / "episodes.csv").read_bytes()
    results = [
        [row for row in rows_of(path / "results.csv") if row["metric"] != "decision_time"]
        for path in (whole, cut)
    ]
    assert results[0] == results[1]
    arrays = [runs.read_arrays(path / "trajectories.npz") for path in (whole, cut)]
    assert all(np.array_equal(arrays[0][key], arrays[1][key]) for key in arrays[0])

    # Other seas, another window and a broken file are run again; what is the same is not.
    compare(names, labels, out=tmp_path / "cut", **given)
    assert acted == ["lqg", "oracle"]
    (kept,) = (tmp_path / "cut").glob("kept/unknown_linear/feedforward.npz")
    kept.write_bytes(kept.read_bytes()[:100])
    compare(names, labels, out=tmp_path / "cut", **given)
    assert acted == ["lqg", "oracle", "feedforward"]
    compare(names, ["none"], out=tmp_path / "cut", **given | {"oracle": False, "warm_up": 2.0})
    assert acted[3:] == ["none"]
