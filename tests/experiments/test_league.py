"""A league: who takes part, what is kept, its numbers, its page, and submissions from a file."""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("safetensors")

from agents.policy import Architecture, TrainedPolicy, policy_card, save_policy
from experiments import cli, league_page, report, runs
from experiments.compare import controller_of, entry_of, run_contest
from experiments.leaderboard import LEAST_SEAS, best, ranked, ratios
from experiments.league import chosen_variants, contestants, league, printed
from experiments.processes import ONE_THREAD, shared_out
from experiments.report import significant
from experiments.rollout import FIRST_TEST_SEED, rollout, with_duration
from heave_env.scenarios import load

SCENARIOS = ("thesis_linear", "unknown_linear")
FILES = {"episodes.csv", "run.json", "kept"} | {f"leaderboard.{end}" for end in ("csv", "json", "html", "md")}
GIVEN = dict(n_seeds=4, duration=20.0, variants="rougher", arguments=["league"])
MINE = """
import numpy as np
class Lifted:
    name = "lifted"
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full((len(observation), 1), 0.01), None
def controller(scenario):
    assert scenario.name and not scenario.nominal
    return Lifted()
"""

WILD = MINE.replace(
    "return np.full((len(observation), 1), 0.01), None",
    "n = 0 if state is None else state\n"
    "        return np.full((len(observation), 1), 1.0 if n % 20 < 10 else -1.0), n + 1",
)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def number(rows, scenario, variant, entry, quantity, training="", column="value") -> float:
    key = (scenario, variant, entry, quantity, training)
    columns = ("scenario", "variant", "entry", "quantity", "training")
    (row,) = (row for row in rows if tuple(row[column] for column in columns) == key)
    return float(row[column])


@pytest.fixture(scope="module")
def players(tmp_path_factory):
    """A submission, and one agent trained twice (in truth, with weights of chance) for `thesis_linear`."""
    folder = tmp_path_factory.mktemp("players")
    (folder / "mine.py").write_text(MINE, encoding="utf-8")
    scenario = load("thesis_linear")
    layers = Architecture(
        n_observations=len(scenario.observation_names),
        feature_bound=5.0,
        hidden=(4,),
        activation="tanh",
        output="clip",
    )
    for i in range(2):
        rng = np.random.default_rng(i)
        weights = {name: rng.normal(0.0, 0.01, shape) for name, shape in layers.shapes.items()}
        (folder / f"ppo_{i}").mkdir()
        policy = TrainedPolicy(layers, weights, policy_card(scenario, algorithm="ppo"))
        save_policy(folder / f"ppo_{i}" / "policy.json", policy)
    return folder


@pytest.fixture(scope="module")
def asked(players):
    return ["none", "lqg", f"mine=file:{players}/mine.py", f"ppo=agent:{players}/ppo_*"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, asked):
    """Two scenarios as they are and in one variant, four seas of 20 s."""
    chosen = [load(name) for name in SCENARIOS]
    return league(chosen, asked, out=tmp_path_factory.mktemp("league") / "out", oracle=True, **GIVEN)


@pytest.fixture(scope="module")
def rows(folder):
    return rows_of(folder / "leaderboard.csv")


@pytest.fixture(scope="module")
def costs(folder):
    """J by scenario, variant, entry and training, (n_seas,)."""
    found: dict[tuple[str, ...], list[float]] = {}
    for row in rows_of(folder / "episodes.csv"):
        key = tuple(row[column] for column in ("scenario", "variant", "entry", "training"))
        found.setdefault(key, []).append(float(row["cost [-]"]))
    return {key: np.array(values) for key, values in found.items()}


# What is written ---------------------------------------------------------------------------------


def test_every_sea_of_everybody_is_told_and_paired(folder, costs):
    assert {path.name for path in folder.iterdir()} == FILES
    assert {int(row["sea"]) for row in rows_of(folder / "episodes.csv")} == set(
        range(FIRST_TEST_SEED, FIRST_TEST_SEED + 4)
    )
    for variant in ("nominal", "rougher"):
        for name in SCENARIOS:
            for entry in ("none", "lqg", "mine"):
                assert len(costs[name, variant, entry, ""]) == 4
        # The agent was trained for one of the scenarios, and takes part in that.
        assert {key[3] for key in costs if key[1:3] == (variant, "ppo")} == {"ppo_0", "ppo_1"}
    assert not any(key[0] == "unknown_linear" for key in costs if key[2] == "ppo")


def test_controllers_of_a_variant_are_those_of_the_scenario(costs):
    scenario, met = load("thesis_linear"), load("thesis_linear@rougher")
    trajectory = rollout(met, controller_of("lqg", scenario), [FIRST_TEST_SEED], duration=20.0)
    stage = trajectory.steps["position_cost"] + trajectory.steps["command_cost"]
    assert costs["thesis_linear", "rougher", "lqg", ""][0] == pytest.approx(stage[50:, 0].mean())


def test_the_leaderboard_is_made_of_the_episodes(rows, costs):
    name = "thesis_linear"
    lqg = costs[name, "nominal", "lqg", ""]
    ppo = np.stack([costs[name, "nominal", "ppo", f"ppo_{i}"] for i in range(2)])
    ratio = ppo.mean() / lqg.mean()
    assert number(rows, name, "nominal", "ppo", "cost_ratio_to_lqg") == pytest.approx(ratio)
    low, high = (
        number(rows, name, "nominal", "ppo", "cost_ratio_to_lqg", column=column) for column in ("low", "high")
    )
    assert low < ratio < high
    per_sea = ppo / lqg
    for quantity, expected in (
        ("cost_ratio_median", np.median(per_sea)),
        ("cost_ratio_p95", np.quantile(per_sea, 0.95)),
        ("cost_ratio_maximum", per_sea.max()),
        ("cost_ratio_interquartile_mean", np.sort(per_sea, axis=None)[2:6].mean()),
        ("probability_of_improvement", (ppo < lqg).mean()),
        ("cost", ppo.mean()),
        ("cost_maximum", ppo.max()),
        ("diverged", 0),
    ):
        assert number(rows, name, "nominal", "ppo", quantity) == pytest.approx(expected), quantity
    alone = number(rows, name, "nominal", "ppo", "cost_ratio_to_lqg", "ppo_1")
    assert alone == pytest.approx(ppo[1].mean() / lqg.mean())
    assert number(rows, name, "nominal", "lqg", "cost_ratio_to_lqg") == 1.0
    for quantity, expected in (
        ("cost_difference", ppo.mean() - lqg.mean()),
        ("decision_time_alone", None),
        ("decision_time", None),
    ):
        found = number(rows, name, "nominal", "ppo", quantity)
        assert found > 0.0 if expected is None else found == pytest.approx(expected), quantity
    low, high = (
        number(rows, name, "nominal", "ppo", "cost_difference", column=column) for column in ("low", "high")
    )
    assert low < ppo.mean() - lqg.mean() < high
    assert not any(row["quantity"] == "cost_difference" for row in rows if row["entry"] == "lqg")
    assert not any(row["quantity"] == "decision_time_alone" for row in rows if row["variant"] == "rougher")


def test_yardsticks_stand_where_there_are_any(folder, rows):
    assert number(rows, "unknown_linear", "nominal", "lqg", "cost_ratio_to_oracle") > 1.0
    assert number(rows, "thesis_linear", "nominal", "lqg", "cost_ratio_to_optimum") > 0.0
    assert not any(
        row["quantity"] == "cost_ratio_to_oracle" for row in rows if row["scenario"] == "thesis_linear"
    )
    summary = json.loads((folder / "leaderboard.json").read_text(encoding="utf-8"))
    assert "oracle" in summary["scenarios"]["unknown_linear"]["variants"]["rougher"]["yardsticks"]
    assert "trained in scenario 'thesis_linear'" in summary["scenarios"]["unknown_linear"]["left_out"]["ppo"]


def test_what_is_pooled_counts_each_scenario_alike(rows):
    parts = [number(rows, name, "nominal", "none", "cost_ratio_to_lqg") for name in SCENARIOS]
    assert number(rows, "*", "nominal", "none", "cost_ratio_to_lqg") == pytest.approx(np.mean(parts))
    parts = [number(rows, name, "rougher", "none", "cost_ratio_to_lqg") for name in SCENARIOS]
    assert number(rows, "*", "*", "none", "cost_ratio_to_lqg") == pytest.approx(np.mean(parts))
    assert not any(row["scenario"] == "*" and row["entry"] == "ppo" for row in rows)


def test_the_json_says_the_same_as_the_table(folder, rows):
    summary = json.loads((folder / "leaderboard.json").read_text(encoding="utf-8"))
    told = {
        (item["scenario"], item["variant"], name, key): found["value"]
        for item in summary["standings"]
        for name, entry in item["entries"].items()
        for key, found in entry["quantities"].items()
    }
    table = {
        (row["scenario"], row["variant"], row["entry"], row["quantity"]): float(row["value"])
        for row in rows
        if not row["training"]
    }
    assert told == table
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert run["kind"] == "league"
    assert [len(item["content"]) for item in run["contestants"]] == [1, 1, 1, 2]


def test_who_diverges_is_named(capsys, tmp_path):
    """A command that ends in the strokes' full range breaks a cable that is weak enough."""
    from heave_env.scenarios import with_values

    (tmp_path / "wild.py").write_text(WILD, encoding="utf-8")
    weak = with_values(load("thesis_cable"), {"cable.breaking_strength": 4e5})
    given = GIVEN | {"variants": "nominal", "n_seeds": 3}
    asked = ["none", f"wild=file:{tmp_path}/wild.py"]
    out = league([weak], asked, out=tmp_path / "out", reference="none", **given)
    summary = json.loads((out / "leaderboard.json").read_text(encoding="utf-8"))
    with (out / "episodes.csv").open(newline="", encoding="utf-8") as file:
        lost = [row for row in csv.DictReader(file) if "1" in (row["diverged"], row["lost"])]
    assert {row["entry"] for row in lost} == {"wild"} and len(lost) == 3
    (item,) = summary["failures"]
    assert (item["entry"], item["diverged"] + item["lost"], item["n_seas"]) == ("wild", 3, 3)
    said = "wild lost the payload in 3 of 3 seas of thesis_cable"
    assert said in printed(summary)
    assert any(line.startswith("  wild: ") and ", 3 lost of 3 seas" in line for line in printed(summary))
    assert said in (out / "leaderboard.html").read_text(encoding="utf-8")


def test_the_work_is_told(folder):
    summary = json.loads((folder / "leaderboard.json").read_text(encoding="utf-8"))
    work = summary["work"]
    assert set(work["seconds_per_sea"]) >= {"none", "lqg", "file:mine", "oracle"}
    assert all(seconds > 0.0 for seconds in work["seconds_per_sea"].values())
    # Two scenarios as they are and in a variant, four seas each.
    assert work["hours"] * 3600.0 >= 16 * work["seconds_per_sea"]["lqg"]
    (line,) = (line for line in printed(summary) if line.startswith("work: "))
    assert "slowest, in seconds per sea: " in line


def test_nobody_is_blamed_without_reason(folder):
    summary = json.loads((folder / "leaderboard.json").read_text(encoding="utf-8"))
    assert summary["failures"] == []
    assert printed(summary)[-1] == "nobody diverged or lost the payload"
    assert "Nobody diverged or lost the payload" in (folder / "leaderboard.html").read_text(encoding="utf-8")


# The page ----------------------------------------------------------------------------------------


class Page(HTMLParser):
    """Collects links, images, and for every row of every table its name and its numbers by quantity."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links, self.images = [], []
        self.sections: dict[str, list[dict[str, str]]] = {}
        self.section, self.place, self.row = "", "", {}
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        if tag == "section":
            self.section = found.get("id", "")
        if tag == "tr":
            self.row = {"name": ""}
            self.sections.setdefault(self.section, []).append(self.row)
        self.links += [found["href"]] if "href" in found else []
        self.images += [found["src"]] if "src" in found else []
        self.place = (
            "" if tag == "small" else found.get("data-quantity", "name" if tag == "th" else self.place)
        )

    def handle_data(self, data):
        if self.place and self.row:
            self.row[self.place] = self.row.get(self.place, "") + data.strip()
            self.place = ""

    def handle_endtag(self, tag):
        # The dot before a name is an element of its own.
        self.place = "name" if tag == "span" and not self.row.get("name") else ""


def test_numbers_in_the_page_are_those_of_the_table(folder, rows):
    page = Page((folder / "leaderboard.html").read_text(encoding="utf-8"))
    factors = {"payload_heave_std": 1e3, "probability_of_improvement": 1e2, "decision_time": 1.0}
    for scenario in SCENARIOS:
        first = {}
        for row in page.sections[scenario]:
            for quantity, text in row.items():
                first.setdefault((row["name"], quantity), text)  # the nominal tables come first
        entries = {row["entry"] for row in rows if (row["scenario"], row["variant"]) == (scenario, "nominal")}
        for entry in entries:
            for quantity in ("cost_ratio_to_lqg", "cost_ratio_p95", "cost", *factors):
                if (entry, quantity) == ("lqg", "probability_of_improvement"):
                    continue
                value = factors.get(quantity, 1.0) * number(rows, scenario, "nominal", entry, quantity)
                assert first[entry, quantity] == significant(value, 4), (entry, quantity)


def test_numbers_in_the_markdown_tables_are_those_of_the_table(folder, rows):
    text = (folder / "leaderboard.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"\*\*(.*?)\*\*\n\n(.*?)\n\n", text, flags=re.DOTALL))
    assert {f"{name}{end}" for name in SCENARIOS for end in ("", "@rougher")} <= set(sections)
    for scenario in SCENARIOS:
        head, rule, *body = [line.strip("| ").split(" | ") for line in sections[scenario].split("\n")]
        assert {len(line) for line in body} == {len(head) + 1} == {len(rule[0].split("|"))}
        assert head[0] == "J / lqg"
        for name, *cells in body:
            value = number(rows, scenario, "nominal", name.strip("`"), "cost_ratio_to_lqg")
            assert cells[0].split(" (")[0] == significant(value, 4)
    assert "nan" not in text.lower()


def test_the_page_is_self_contained_but_for_links_to_its_files(folder):
    text = (folder / "leaderboard.html").read_text(encoding="utf-8")
    page = Page(text)
    files = {link for link in page.links if not link.startswith("#")}
    assert files == {"leaderboard.csv", "leaderboard.json", "episodes.csv", "run.json"}
    assert all((folder / link).is_file() for link in files)
    assert page.images and all(image.startswith("data:image/svg+xml;base64,") for image in page.images)
    assert "<script" not in text and "http" not in text.replace("data:image/svg+xml", "")
    assert ">nan<" not in text.lower() and ">none</td>" not in text.lower()


def test_rows_are_sorted_and_the_best_is_marked_where_it_is_said(folder):
    summary = json.loads((folder / "leaderboard.json").read_text(encoding="utf-8"))
    for item in summary["standings"]:
        values = [entry["quantities"]["cost_ratio_to_lqg"]["value"] for entry in item["entries"].values()]
        assert values == sorted(values)
        assert item["best"] is None  # of four seas
    assert ">best<" not in (folder / "leaderboard.html").read_text(encoding="utf-8")
    # Had it been surely the best there: in its two tables, and where the variants stand side by side.
    summary["standings"][0]["best"] = "lqg"
    assert league_page.page_text(summary).count(">best<") == 3


def test_nobody_is_best_by_chance():
    class Shown:
        def __init__(self, cost):
            self.cost = cost

    class Place:
        def __init__(self, **costs):
            self.results = {name: Shown(np.atleast_2d(cost)) for name, cost in costs.items()}

    sea = np.linspace(1.0, 9.0, 40)
    rng = np.random.default_rng(0)
    noise = rng.permuted(np.linspace(-0.5, 0.5, 40))
    alike = Place(one=sea, other=sea + noise + 0.01)
    assert best([alike], ["one", "other"]) is None
    assert best([Place(one=sea, other=sea + 0.01)], ["one", "other"]) == "one"
    assert best([Place(one=sea, other=sea + 0.01, third=sea)], ["one", "third", "other"]) is None
    assert best([alike], ["one"]) is None
    few = sea[: LEAST_SEAS - 1]
    assert best([Place(one=few, other=few + 0.01)], ["one", "other"]) is None
    assert ranked({"b": {}, "a": {}}, "a") == ["b", "a"]


def test_a_ratio_to_nothing_is_no_number():
    found = ratios(np.array([[1.0, 2.0, 3.0]]), np.array([[0.0, 4.0, np.nan]]))
    np.testing.assert_array_equal(found, [[np.nan, 0.5, np.nan]])


def test_a_bound_that_says_nothing_is_left_off_the_page(folder):
    summary = json.loads((folder / "leaderboard.json").read_text(encoding="utf-8"))
    quantity = "payload_heave_std_ratio_to_bound"
    item = next(item for item in summary["standings"] if item["scenario"] == "thesis_linear")
    found = [entry["quantities"][quantity] for entry in item["entries"].values()]
    assert min(number["value"] for number in found) > 100.0
    assert quantity not in [column[2] for column in league_page.load_columns(item, "lqg")]
    found[0]["value"] = 1.5
    assert quantity in [column[2] for column in league_page.load_columns(item, "lqg")]


def test_the_page_is_redrawn_without_simulating(folder, monkeypatch):
    def refuse(*arguments, **options):
        raise AssertionError("a report simulates nothing")

    monkeypatch.setattr("heave_env.env.HeaveVectorEnv.__init__", refuse)
    before = (folder / "leaderboard.html").read_text(encoding="utf-8")
    (folder / "leaderboard.html").unlink()
    assert report.write_report(folder).read_text(encoding="utf-8") == before


# Interrupted -------------------------------------------------------------------------------------


def test_an_interrupted_league_goes_on_where_it_was(folder, asked, tmp_path, monkeypatch):
    chosen, out = [load(name) for name in SCENARIOS], tmp_path / "out"

    def stop(scenario, label, count, total):
        if scenario == "thesis_linear@rougher" and label == "lqg":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        league(chosen, asked, out=out, oracle=True, progress=stop, **GIVEN)
    assert [path.name for path in out.iterdir()] == ["kept"]
    done = {path: path.stat().st_mtime_ns for path in out.rglob("*.npz")}
    assert len(done) == 5 + 1  # all of the scenario as it is, and the locked winch of its variant

    acted = []

    def noted(scenario, controller, seeds, **options):
        acted.extend([scenario.name] * (len(seeds) > 1))  # alone in a sea its decisions are timed
        return rollout(scenario, controller, seeds, **options)

    monkeypatch.setattr("experiments.compare.rollout", noted)
    league(chosen, asked, out=out, oracle=True, **GIVEN)
    assert {path: path.stat().st_mtime_ns for path in done} == done
    assert acted.count("thesis_linear") == 0 and acted.count("thesis_linear@rougher") == 4
    assert (out / "episodes.csv").read_bytes() == (folder / "episodes.csv").read_bytes()
    tables = [
        [row for row in rows_of(path / "leaderboard.csv") if not row["quantity"].startswith("decision_time")]
        for path in (out, folder)
    ]
    assert tables[0] == tables[1]
    files = {name: (out / name).read_bytes() for name in ("episodes.csv", "leaderboard.csv")}
    league(chosen, asked, out=out, oracle=True, **GIVEN)
    assert all((out / name).read_bytes() == content for name, content in files.items())


def test_slow_controllers_are_run_and_kept_by_some_seas_at_a_time(tmp_path, monkeypatch):
    place = with_duration(load("unknown_linear"), 20.0)
    entries = [entry_of(name, name, place) for name in ("none", "lqg")]
    seeds = range(FIRST_TEST_SEED, FIRST_TEST_SEED + 5)
    found = {}
    for name in ("whole", "parts"):
        found[name] = run_contest(place, entries, seeds, n_stored=0, oracle=True, folder=tmp_path / name)
        monkeypatch.setattr("experiments.compare.SLOW", ("lqg",))
        monkeypatch.setattr("experiments.compare.SLOW_SEAS", 2)
    names = {path.stem for path in (tmp_path / "parts").rglob("*.npz")}
    assert {name.rpartition("-")[0] or name for name in names} == {
        "none",
        *(f"{label}_{first}" for label in ("lqg", "oracle") for first in (0, 2, 4)),
    }
    whole, parts = (found[name].outcomes[1] for name in ("whole", "parts"))
    for metric, row in whole.values.items():
        np.testing.assert_allclose(parts.values[metric], row, rtol=1e-9, atol=1e-12, err_msg=metric)
    for end, row in whole.ends.items():
        np.testing.assert_array_equal(parts.ends[end], row)
    np.testing.assert_allclose(found["parts"].oracles["oracle"], found["whole"].oracles["oracle"], rtol=1e-9)
    assert parts.decision_time > 0.0 and parts.batch == 2


@pytest.mark.parametrize(
    ("scenario", "asked", "options"),
    [
        ("thesis_linear", ["lqg"], {}),
        pytest.param("unknown_linear", ["none", "lqg"], {"oracle": True}, marks=pytest.mark.slow),
        pytest.param(
            "thesis_linear", ["none", "ppo=agent:RUN"], {"reference": "none"}, marks=pytest.mark.slow
        ),
    ],
)
def test_two_processes_find_what_one_does(players, tmp_path, monkeypatch, scenario, asked, options):
    """Designs, agents and the oracle go to the workers; a Python file stays where it was loaded."""
    here, told = [], []
    asked = [spec.replace("RUN", f"{players}/ppo_*") for spec in asked] + [f"mine=file:{players}/mine.py"]
    given = dict(n_seeds=2, duration=20.0, variants="nominal", arguments=["league"]) | options
    chosen = [load(scenario)]
    alone = league(chosen, asked, out=tmp_path / "alone", **given)

    def noted(scenario, controller, seeds, **options):
        here.extend([controller.name] * (len(seeds) > 1))
        return rollout(scenario, controller, seeds, **options)

    monkeypatch.setattr("experiments.compare.rollout", noted)
    given["progress"] = lambda *what: told.append(what[1])
    out = league(chosen, asked, out=tmp_path / "out", workers=2, **given)
    assert here == ["lifted"]
    assert set(told) >= {"designs", *(["oracle", "lqg"] if "oracle" in options else [])}
    assert (out / "episodes.csv").read_bytes() == (alone / "episodes.csv").read_bytes()


@pytest.mark.parametrize("_", range(5))
def test_what_a_worker_raises_ends_the_work(_):
    """Several times: two threads that reap one process leave it among the living now and then."""
    done = []
    with pytest.raises(ValueError, match="invalid literal"):
        for job, result in shared_out(int, ["1", "2", "x", "3"], 2):
            done.append((job, result))
    assert set(done) <= {("1", 1), ("2", 2), ("3", 3)}
    assert not multiprocessing.active_children()
    assert dict(shared_out(int, ["1", "2"], 2)) == {"1": 1, "2": 2} == dict(shared_out(int, ["1", "2"], 1))


def test_workers_are_kept_to_one_thread(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert dict(shared_out(os.getenv, list(ONE_THREAD), 2)) == dict.fromkeys(ONE_THREAD, "1")
    assert os.environ["OMP_NUM_THREADS"] == "7"


@pytest.mark.slow
def test_an_interruption_reaches_all_processes_and_keeps_what_is_finished(tmp_path):
    """Ctrl-C goes to the whole group; the same command then goes on with what the workers had finished."""
    out = tmp_path / "out"
    asked = ["unknown_linear", "--controllers", "none,lqg,multi_model", "--variants", "nominal"]
    given = ["--seeds", "8", "--workers", "2", "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "experiments.cli", "league", *asked, *given],
        cwd=Path(__file__).parents[2],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    for _ in range(1200):
        if list(out.rglob("none.npz")) or process.poll() is not None:
            break
        time.sleep(0.2)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130 and said == "heave: interrupted; the same command goes on from there\n"
    kept = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}
    assert "none.npz" in {path.name for path in kept}
    assert not [path for path in kept if path.suffix == ".tmp"]
    duration = ["--duration", "400"]  # what the protocol has anyway
    assert cli.main(["league", *asked[:2], "none,lqg", *asked[3:], *given[:-2], *duration, *given[-2:]]) == 0
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in kept.items())


def test_a_changed_policy_or_file_runs_again(players, tmp_path, monkeypatch):
    mine = tmp_path / "mine.py"
    mine.write_text(MINE, encoding="utf-8")
    acted = []

    def noted(scenario, controller, seeds, **options):
        acted.extend([controller.name] * (len(seeds) > 1))
        return rollout(scenario, controller, seeds, **options)

    monkeypatch.setattr("experiments.compare.rollout", noted)
    given = GIVEN | {"variants": "nominal", "n_seeds": 2}
    asked, chosen = ["lqg", f"file:{mine}"], [load("thesis_linear")]
    first = rows_of(league(chosen, asked, out=tmp_path / "out", **given) / "leaderboard.csv")
    assert acted == ["none", "lqg", "lifted"]
    mine.write_text(MINE.replace("0.01", "0.02"), encoding="utf-8")
    second = rows_of(league(chosen, asked, out=tmp_path / "out", **given) / "leaderboard.csv")
    assert acted[3:] == ["lifted"]
    energy = [
        number(found, "thesis_linear", "nominal", "file:mine", "control_energy") for found in (first, second)
    ]
    assert energy[1] == pytest.approx(4.0 * energy[0])


# Asked for wrongly -------------------------------------------------------------------------------


def test_who_takes_part(players):
    found = contestants(["lqg", f"a=agent:{players}/ppo_0+agent:{players}/ppo_1", f"file:{players}/mine.py"])
    assert [item.name for item in found] == ["lqg", "a", "file:mine"]
    assert [len(item.specs) for item in found] == [1, 2, 1]
    assert contestants([f"agent:{players}/ppo_*"])[0].name == "agent:ppo_*"
    everyone = contestants(["all", "best=lqg"])
    assert {"none", "mpc"} <= {item.name for item in everyone} and "lqg" not in {i.name for i in everyone}
    assert [item.asked for item in everyone[:2]] == [True, False]


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ([], "no controller"),
        (["lqgg"], "did you mean 'lqg'"),
        (["lqg", "a=lqg"], "named twice"),
        (["a=lqg", "a=lqr"], "called 'a'"),
        (["oracle=lqg"], "as a yardstick is"),
        (["=lqg"], "NAME=CONTROLLER"),
        (["a=agent:/nowhere/*"], "no trained run matches"),
        (["agent:/nowhere"], "there is no run"),
        (["agent:a+agent:b"], "want a name"),
        (["a=file:a.py+file:b.py"], "only trainings of an agent"),
        (["file:"], "lacks the Python file"),
    ],
)
def test_impossible_contestants_are_refused(given, complaint):
    with pytest.raises(ValueError, match=complaint):
        contestants(given)


def test_variants_are_those_that_make_sense():
    both = [load("thesis_linear"), load("sea_state_5")]
    found = chosen_variants(both, "all")
    assert found["thesis_linear"][0].name == "thesis_linear"
    assert "thesis_linear@later" in [place.name for place in found["thesis_linear"]]
    assert [place.name for place in chosen_variants(both, "nominal")["sea_state_5"]] == ["sea_state_5"]


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"n_seeds": 0}, "at least 1"),
        ({"reference": "pid"}, "not among the contestants"),
        ({"variants": "rough"}, "unknown variant 'rough'"),
        ({"variants": "later,later"}, "named twice"),
        ({"duration": 3.33}, "whole number of control steps"),
        ({"warm_up": 50.0}, "warm-up"),
        ({"scenarios": []}, "no scenario"),
        ({"scenarios": ["thesis_linear"] * 2}, "twice"),
        ({"oracle": True}, "leave --oracle out"),
        ({"controllers": ["none", "feedforward"]}, "needs boom_tip_heave measured"),
        ({"scenarios": ["sea_state_5"], "clairvoyant": True}, "leave --clairvoyant out"),
    ],
)
def test_impossible_leagues_write_nothing(tmp_path, changed, complaint):
    given = {"scenarios": ["thesis_linear"], "controllers": ["none"]} | GIVEN | {"out": tmp_path / "out"}
    given |= changed
    chosen = [load(name) for name in given.pop("scenarios")]
    with pytest.raises(ValueError, match=complaint):
        league(chosen, given.pop("controllers"), **given)
    assert not (tmp_path / "out").exists()


def test_a_reference_must_act_everywhere(tmp_path):
    chosen = [load(name) for name in ("thesis_linear", "sea_state_5")]
    with pytest.raises(ValueError, match="does not act in scenario 'thesis_linear'.*--reference"):
        league(chosen, ["none", "feedforward"], out=tmp_path / "out", reference="feedforward", **GIVEN)


def test_a_comparison_is_not_overwritten(tmp_path):
    (tmp_path / "run.json").write_text('{"kind": "comparison"}', encoding="utf-8")
    with pytest.raises(ValueError, match="another kind of run"):
        league([load("thesis_linear")], ["none"], out=tmp_path, **GIVEN)


# Submissions -------------------------------------------------------------------------------------

HEAD = "import numpy as np\nclass C:\n    def predict(self, observation, state=None, episode_start=None, "
HEAD += "deterministic=True):\n        "


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("x = 1", "it defines no controller"),
        ("def controller(:", "cannot be loaded: SyntaxError"),
        ("import sys\nsys.exit(3)", "cannot be loaded: SystemExit"),
        ("import not_there_at_all", "cannot be loaded: ModuleNotFoundError"),
        ("controller = 7", "is int, which has no predict"),
        ("def controller(scenario):\n    return 7", "makes int, which has no predict"),
        (
            "def controller(scenario):\n    return 1 / 0",
            r"controller\(thesis_linear\) failed with ZeroDivision",
        ),
        (HEAD + "return 1 / 0, None\ncontroller = C()", "predict failed with ZeroDivisionError"),
        (HEAD + "return np.zeros((len(observation), 1))\ncontroller = C()", r"return \(action, state\)"),
        (HEAD + "return np.zeros(3), None\ncontroller = C()", r"shape \(2, 1\), got \(3,\)"),
        (HEAD + "return np.full((2, 1), np.nan), None\ncontroller = C()", "not finite"),
        (HEAD + "return 'up', None\ncontroller = C()", "numbers for actions"),
        (HEAD + "return 0, None\ncontroller = C()\nC.information_set = 'x'", "information_set"),
    ],
)
def test_a_submission_that_is_none_is_told_in_a_sentence(tmp_path, text, complaint):
    path = tmp_path / "theirs.py"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=complaint) as caught:
        controller_of(f"file:{path}", load("thesis_linear"))
    assert "\n" not in str(caught.value) and "theirs.py" in str(caught.value)


def test_a_submission_may_remember_and_import_what_lies_beside_it(tmp_path):
    (tmp_path / "their_gain.py").write_text("GAIN = 0.5", encoding="utf-8")
    (tmp_path / "theirs.py").write_text(
        "from their_gain import GAIN\n"
        + HEAD.replace("class C:", "class C:\n    information_set = 'sensors'")
        + "n = np.zeros(len(observation)) if state is None else state\n"
        "        n = np.where(episode_start, 0.0, n)\n"
        "        return GAIN * np.minimum(n, 1.0)[:, None], n + 0.5\n"
        "    def __init__(self, scenario):\n        self.scenario = scenario\n"
        "controller = C",
        encoding="utf-8",
    )
    scenario = load("thesis_linear")
    found = controller_of(f"file:{tmp_path / 'theirs.py'}", scenario)
    trajectory = rollout(scenario, found, [FIRST_TEST_SEED, FIRST_TEST_SEED + 1], duration=1.0)
    command = trajectory.steps["command"][:4, 0] / scenario.winch.command_range
    np.testing.assert_allclose(command, [0.0, 0.25, 0.5, 0.5], rtol=1e-6)


def test_the_documented_submission_acts(tmp_path):
    told = (Path(__file__).parents[2] / "docs" / "league.md").read_text(encoding="utf-8")
    path = tmp_path / "mine.py"
    path.write_text(told.split("```python\n")[1].split("```")[0], encoding="utf-8")
    scenario = load("thesis_linear")
    trajectory = rollout(scenario, controller_of(f"file:{path}", scenario), [FIRST_TEST_SEED], duration=5.0)
    heave, command = trajectory.states["payload_heave"][:-1, 0], trajectory.steps["command"][:, 0]
    assert np.corrcoef(heave, command)[0, 1] < -0.99


# The command -------------------------------------------------------------------------------------


def test_the_command_prints_the_standing_and_refuses_in_a_sentence(capsys, tmp_path, players):
    common = ["--seeds", "2", "--duration", "20", "--variants", "nominal", "--workers", "1"]
    common += ["--out", str(tmp_path / "out")]
    assert cli.main(["league", "thesis_linear", "--controllers", "none,lqg", *common]) == 0
    out = capsys.readouterr().out
    assert "thesis_linear: J / lqg, lowest first\n  lqg: 1.000" in out
    assert "leaderboard.html" in out
    assert cli.main(["report", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    assert cli.main(["league", "thesis_linear", "--controllers", "file:nowhere.py", *common]) == 2
    err = capsys.readouterr().err
    assert err == "heave: there is no submission 'nowhere.py'; name a Python file\n"
    (tmp_path / "out" / "leaderboard.json").write_text("{}", encoding="utf-8")
    assert cli.main(["report", str(tmp_path / "out")]) == 2
    assert "incomplete" in capsys.readouterr().err


def test_an_interruption_says_that_it_goes_on(capsys, tmp_path, monkeypatch):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("experiments.league.run_contest", interrupt)
    given = ["--controllers", "none", "--seeds", "2", "--workers", "1", "--out", str(tmp_path / "out")]
    assert cli.main(["league", "thesis_linear", *given]) == 130
    assert "the same command goes on from there" in capsys.readouterr().err
    assert runs.LEAGUE == "league" and not (tmp_path / "out").exists()
