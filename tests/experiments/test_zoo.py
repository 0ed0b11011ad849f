"""The zoo on the command line: list, cards, what is measured, its agents wherever a run may stand."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("safetensors")

from agents import zoo
from agents.policy import Architecture, TrainedPolicy, load_policy, policy_card, save_policy
from baselines.oracle import oracle
from experiments import cli
from experiments import zoo as results
from experiments.compare import ZOO_PREFIX, check_specs, content_hash, controller_of
from experiments.evaluate import evaluate
from experiments.league import contestants, league
from experiments.metrics import scores, window
from experiments.rollout import FIRST_TEST_SEED, rollout
from heave_env.scenarios import load, to_mapping

ROOT = Path(__file__).resolve().parents[2]
NAME = "thesis_linear-sensors"
SCENARIO = load("thesis_linear")
SHORT = ("--duration", "20")


def run_folder(folder: Path, seed: int, scenario=SCENARIO) -> Path:
    """A finished training's folder, in truth with weights of chance."""
    layers = Architecture(
        n_observations=len(scenario.observation_names),
        feature_bound=5.0,
        hidden=(4,),
        activation="tanh",
        output="clip",
    )
    rng = np.random.default_rng(seed)
    weights = {name: rng.normal(0.0, 0.01, shape) for name, shape in layers.shapes.items()}
    card = policy_card(scenario, algorithm="ppo", training={"seed": seed, "steps": 10})
    folder.mkdir(parents=True)
    save_policy(folder / "policy.json", TrainedPolicy(layers, weights, card))
    (folder / "evaluations.csv").write_text("step,wall_s,cost_mean\n0,0.1,2.0\n10,0.4,1.0\n")
    run = {
        "kind": "training",
        "algorithm": "ppo",
        "seed": seed,
        "scenario_name": scenario.name,
        "fingerprint": scenario.fingerprint,
        "scenario": to_mapping(scenario),
        "preset": {"algorithm": "ppo", "gamma": 0.98},
        "status": "finished",
        "steps": 10,
        "wall_s": 1.5,
        "best": {"step": 10, "cost_mean": 1.0 + seed},
        "finished": "then",
        "commit": "abc",
        "versions": {"numpy": np.__version__},
    }
    (folder / "run.json").write_text(json.dumps(run))
    return folder


@pytest.fixture(scope="module")
def shipped(tmp_path_factory):
    """A zoo of one agent with two trainings, measured in four seas of 20 s."""
    folder = tmp_path_factory.mktemp("shipped")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(zoo, "FOLDER", folder / "zoo")
        agent = zoo.add([run_folder(folder / f"run_{seed}", seed) for seed in (0, 1)])
        results.measure(agent, n_seas=4, duration=20.0, work=folder / "work")
    return folder


@pytest.fixture(autouse=True)
def shown(shipped, monkeypatch):
    monkeypatch.setattr(zoo, "FOLDER", shipped / "zoo")
    monkeypatch.setattr(results, "WORK", shipped / "work")


def run(capsys, *arguments) -> tuple[int, str, str]:
    try:
        code = cli.main([str(argument) for argument in arguments])
    except SystemExit as left:
        code = int(left.code or 0)
    said = capsys.readouterr()
    return code, said.out, said.err


def refused(capsys, *arguments) -> str:
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "") and err.startswith("heave: ") and err.count("\n") == 1
    return err


def costs_of(path: Path, column: str) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            found.setdefault(row[column], []).append(float(row["cost [-]"]))
    return found


# The list, the card, and what is measured ---------------------------------------------------------


def test_an_agent_with_lags_of_its_own_sees_them_wherever_it_acts(capsys, tmp_path):
    """In a contest, alone, on a picture, and as a submission of another."""
    seen = replace(SCENARIO, information_set="sensors_history", history_lags=(0, 3))
    assert len(seen.observation_names) != len(
        replace(SCENARIO, information_set="sensors_history").observation_names
    )
    folder = run_folder(tmp_path / "run", 0, seen)
    trajectory = rollout(SCENARIO, load_policy(folder), range(3), duration=5.0)
    wider = rollout(seen, load_policy(folder), range(3), duration=5.0)
    np.testing.assert_array_equal(trajectory.states["payload_heave"], wider.states["payload_heave"])
    made = tmp_path / "mine.py"
    made.write_text(
        "from agents.policy import load_policy\n\n\n"
        f"def controller(scenario):\n    return load_policy({str(folder)!r})\n"
    )
    asked = ["thesis_linear", "--controllers", f"none,agent:{folder},mine=file:{made}", "--seeds", "2"]
    code, _, err = run(capsys, "league", *asked, *SHORT, "--variants", "nominal", "--out", tmp_path / "out")
    assert code == 0, err
    summary = json.loads((tmp_path / "out" / "leaderboard.json").read_text(encoding="utf-8"))
    assert summary["scenarios"]["thesis_linear"]["left_out"] == {}


def test_where_parameters_are_drawn_the_card_knows_who_knows_them(tmp_path, monkeypatch):
    """The ratio to the oracle is that of the means in the same seas."""
    scenario = load("unknown_linear")
    monkeypatch.setattr(zoo, "FOLDER", tmp_path / "zoo")
    agent = zoo.add([run_folder(tmp_path / f"run_{seed}", seed, scenario) for seed in (0, 1)])
    measured = results.measure(agent, n_seas=3, duration=20.0, rivals=("lqg",), work=tmp_path / "work")
    found = measured.card["results"]
    assert list(found["agent"]["ratios"]) == ["lqg", "oracle"]
    seeds = range(results.FIRST_CARD_SEED, results.FIRST_CARD_SEED + 3)
    knows = rollout(scenario, oracle(scenario, seeds), seeds, duration=20.0)
    own = scores(knows, window(20.0, scenario.control_dt, found["warm_up"]))["cost"].mean()
    assert found["agent"]["ratios"]["oracle"]["value"] == pytest.approx(
        found["agent"]["cost"]["value"] / own, rel=1e-6
    )
    for row in found["trainings"].values():
        assert row["ratios"]["oracle"]["value"] == pytest.approx(row["cost"]["value"] / own, rel=1e-6)
    assert "of oracle" in results.ratios_text(measured)


def test_the_list_and_the_card_tell_the_agents(capsys):
    code, out, _ = run(capsys, "zoo", "list")
    assert code == 0
    (row,) = (line for line in out.splitlines() if line.startswith(NAME))
    assert "thesis_linear" in row and "ppo sensors" in row and "of lqg" in row and "of the optimum" in row
    assert "1 agents, 0.0" in out
    for name in (NAME, f"zoo:{NAME}"):
        code, out, _ = run(capsys, "zoo", "show", name)
        assert code == 0
        assert f"heave train thesis_linear --algorithm ppo --preset zoo:{NAME} --seed SEED --out DIR" in out
        assert "seed 1: 10 steps" in out and "4 validation seas from seed 10100000" in out


def test_the_cards_numbers_are_those_of_the_protocol(shipped):
    card = zoo.read(NAME).card
    found = card["results"]
    part = window(20.0, SCENARIO.control_dt)
    seeds = range(10_100_000, 10_100_004)
    rows = {}
    for name, controller in (
        ("0", load_policy(zoo.policy_folder(f"zoo:{NAME}/0"))),
        ("1", load_policy(zoo.policy_folder(f"zoo:{NAME}/1"))),
        ("lqg", controller_of("lqg", SCENARIO)),
    ):
        rows[name] = scores(rollout(SCENARIO, controller, seeds, duration=20.0), part)
    for seed in "01":
        for quantity in ("cost", "payload_heave_std", "control_energy"):
            told = found["trainings"][seed][quantity]["value"]
            assert told == pytest.approx(rows[seed][quantity].mean(), rel=1e-12), (seed, quantity)
        ratio = rows[seed]["cost"].mean() / rows["lqg"]["cost"].mean()
        assert found["trainings"][seed]["ratios"]["lqg"]["value"] == pytest.approx(ratio)
    both = (rows["0"]["cost"].mean() + rows["1"]["cost"].mean()) / 2.0
    assert found["agent"]["cost"]["value"] == pytest.approx(both)
    assert found["agent"]["ratios"]["lqg"]["value"] == pytest.approx(both / rows["lqg"]["cost"].mean())
    assert found["rivals"]["lqg"]["cost"]["value"] == pytest.approx(rows["lqg"]["cost"].mean())
    assert (found["n_seas"], found["first_sea"], found["scored"]) == (4, 10_100_000, 15.0)


def test_the_seas_are_those_of_a_trainings_card():
    train = pytest.importorskip("agents.train")
    assert results.FIRST_CARD_SEED == train.FIRST_CARD_SEED


def test_rivals_are_the_strongest_designs_of_a_scenario():
    assert results.rivals_of(load("thesis_linear")) == ("lqg",)
    assert results.rivals_of(load("limits_linear")) == ("lqg", "mpc")
    assert results.rivals_of(load("energy_linear")) == ("lqg", "mpc_l1")
    assert results.rivals_of(load("unknown_linear")) == ("lqg", "multi_model")
    both = ("lqg", "mpc", "multi_model", "multi_model_mpc")
    assert results.rivals_of(load("limits_unknown_cable")) == both


def test_a_run_is_added_and_measured_by_the_command(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(zoo, "FOLDER", tmp_path / "zoo")
    for seed in (2, 3):
        run_folder(tmp_path / str(seed), seed)
    code, out, _ = run(capsys, "zoo", "add", tmp_path / "2", "--unmeasured")
    assert code == 0 and f"{NAME}: 1 seeds" in out
    assert "not measured: heave zoo measure" in run(capsys, "zoo", "list")[1]
    assert "not measured: heave zoo measure" in run(capsys, "zoo", "show", NAME)[1]
    given = ("--seas", 2, *SHORT, "--rivals", "none,lqg")
    code, out, _ = run(capsys, "zoo", "add", tmp_path / "3", *given)
    assert code == 0 and "of none" in out and "of lqg" in out
    assert set(zoo.read(NAME).card["results"]["trainings"]) == {"2", "3"}
    assert "already" in refused(capsys, "zoo", "add", tmp_path / "3", *given)
    code, out, _ = run(capsys, "zoo", "measure", "--seas", 3, *SHORT, "--rivals", "lqg")
    assert code == 0 and zoo.read(NAME).card["results"]["n_seas"] == 3


# Its agents wherever a run may stand ----------------------------------------------------------------


def test_an_agent_is_evaluated_in_the_seas_of_a_comparison(capsys, tmp_path):
    found = evaluate(f"zoo:{NAME}", n_seeds=3, duration=20.0)
    assert list(found.seeds) == [FIRST_TEST_SEED + i for i in range(3)]
    assert found.trainings == ("seed 0", "seed 1")
    code, _, _ = run(
        capsys,
        "compare",
        "thesis_linear",
        "--controllers",
        f"none,zoo:{NAME}",
        "--seeds",
        3,
        *SHORT,
        "--out",
        tmp_path,
    )
    assert code == 0
    costs = costs_of(tmp_path / "episodes.csv", "controller")
    assert set(costs) == {"none", f"zoo:{NAME}/0", f"zoo:{NAME}/1"}
    for seed in (0, 1):
        assert found.quantities(seed)["cost"].value == pytest.approx(np.mean(costs[f"zoo:{NAME}/{seed}"]))
    both = costs[f"zoo:{NAME}/0"] + costs[f"zoo:{NAME}/1"]
    assert found.quantities()["cost"].value == pytest.approx(np.mean(both))
    assert found.quantities()["cost_maximum"].value == pytest.approx(np.max(both))


@pytest.mark.parametrize("agent", [f"zoo:{NAME}", f"zoo:{NAME}/1", "RUN", "agent:RUN", "lqg"])
def test_evaluate_prints_costs_motion_and_failures(capsys, shipped, agent):
    given = ("--scenario", "thesis_linear@rougher") if agent == "lqg" else ()
    agent = agent.replace("RUN", str(shipped / "run_0"))
    code, out, _ = run(capsys, "evaluate", agent, "--seeds", 2, *SHORT, *given)
    assert code == 0
    for word in (
        "cost",
        "payload_heave_std",
        "control_energy",
        "no sea diverged or was lost",
        "2 unseen seas",
    ):
        assert word in out, word
    assert ("seed 0" in out) == (agent == f"zoo:{NAME}")
    assert "thesis_linear@rougher" in out or agent != "lqg"


def test_tensions_are_told_where_there_is_a_cable(capsys):
    given = ("--scenario", "thesis_cable", "--seeds", 2, *SHORT)
    out = run(capsys, "evaluate", "none", *given)[1]
    assert "tension_peak" in out and "winch_work" in out


def test_the_league_takes_all_seeds_for_one_agent_and_the_zoo_by_itself(tmp_path):
    chosen = [load("thesis_linear"), load("thesis_regulator")]
    given = dict(n_seeds=2, duration=20.0, variants="rougher", reference="none", arguments=["league"])
    out = league(chosen, ["none"], out=tmp_path / "out", zoo=True, **given)
    with (out / "episodes.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    ours = [row for row in rows if row["entry"] == f"zoo:{NAME}"]
    assert {row["training"] for row in ours} == {"seed 0", "seed 1"}
    assert {(row["scenario"], row["variant"]) for row in ours} == {
        ("thesis_linear", "nominal"),
        ("thesis_linear", "rougher"),
    }
    summary = json.loads((out / "leaderboard.json").read_text(encoding="utf-8"))
    assert summary["scenarios"]["thesis_regulator"]["left_out"] == {}


def test_who_takes_part_of_the_zoo():
    assert [item.name for item in contestants(["lqg"], zoo=True)] == ["lqg", f"zoo:{NAME}"]
    (mine, second) = contestants([f"mine=zoo:{NAME}", "lqg"], zoo=True)
    assert (mine.name, len(mine.specs), second.name) == ("mine", 2, "lqg")
    (one,) = contestants([f"zoo:{NAME}/1"])
    assert (one.name, one.specs) == (f"zoo:{NAME}/1", (f"zoo:{NAME}/1",))
    assert ZOO_PREFIX == zoo.PREFIX
    with pytest.raises(ValueError, match="named twice"):
        check_specs([f"zoo:{NAME}", f"zoo:{NAME}/1"])


def test_a_policy_in_the_zoo_is_told_from_its_run_whose_weights_are_not_rounded(shipped):
    specs = [f"zoo:{NAME}/1", f"zoo:{NAME}/0", f"agent:{shipped / 'run_1'}"]
    assert len({content_hash(spec) for spec in specs}) == 3


def test_it_simulates_and_surveys(capsys, tmp_path):
    out = tmp_path / "run.csv"
    assert (
        run(capsys, "simulate", "thesis_linear", "--controller", f"zoo:{NAME}", *SHORT, "--out", out)[0] == 0
    )
    best = tmp_path / "best.csv"
    run(capsys, "simulate", "thesis_linear", "--controller", f"zoo:{NAME}/0", *SHORT, "--out", best)
    series = [
        [line for line in path.read_text().splitlines() if not line.startswith("#")] for path in (out, best)
    ]
    assert series[0] == series[1] and len(series[0]) == 202
    scatter = tmp_path / "scatter.csv"
    scatter.write_text("significant_wave_height,peak_period,occurrence\n2,8,3\n3,9,1\n")
    code, said, _ = run(
        capsys,
        "operability",
        "thesis_linear",
        *("--controllers", f"none,zoo:{NAME}", "--scatter", scatter, "--limits", "payload_heave_std=5"),
        *("--seeds", 2, *SHORT, "--out", tmp_path / "seas"),
    )
    assert code == 0 and f"zoo:{NAME}/0" in said and f"zoo:{NAME}/1" in said


def test_a_fresh_process_evaluates_without_torch(shipped):
    code = (
        "import sys; from experiments import cli; "
        f"code = cli.main(['evaluate', 'zoo:{NAME}', '--seeds', '2', '--duration', '20']); "
        "print(code, [name for name in ('torch', 'stable_baselines3') if name in sys.modules])"
    )
    given = {**os.environ, "HEAVE_ZOO": str(shipped / "zoo")}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, env=given, check=False
    )
    assert done.stdout.splitlines()[-1] == "0 []", done.stderr


# Asked for wrongly --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("evaluate zoo:thesis_linear-sensor", f"did you mean '{NAME}'"),
        (f"evaluate zoo:{NAME}/9", "no training of seed 9"),
        ("evaluate nowhere", "there is no agent 'nowhere'"),
        ("evaluate lqg", "name one with --scenario"),
        (f"evaluate zoo:{NAME} --set winch.command_delay=0.4", "name it with --scenario"),
        (f"evaluate zoo:{NAME} --scenario sea_state_5", "was trained in scenario 'thesis_linear'"),
        (f"evaluate zoo:{NAME} --seeds 0", "at least 1"),
        ("compare thesis_linear --controllers zoo:none --out OUT", "no agent 'none' in the zoo"),
        (f"compare sea_state_5 --controllers zoo:{NAME} --out OUT", "was trained in scenario"),
        (f"league thesis_regulator --controllers none,zoo:{NAME} --out OUT", "was trained in scenario"),
        (f"simulate sea_state_5 --controller zoo:{NAME} --out OUT", "was trained in scenario"),
        ("train thesis_linear --preset zoo:none --out OUT", "no agent 'none' in the zoo"),
        ("zoo show", "wants the name of one agent"),
        ("zoo show none", "heave zoo list"),
        ("zoo list more", "takes no name"),
        ("zoo list --seas 4", "zoo list takes no --seas"),
        ("zoo measure --name x", "zoo measure takes no --name"),
        ("zoo add", "no run folder was named"),
        ("zoo add nowhere", "no run folder that heave train has written"),
        ("zoo add --unmeasured nowhere", "no run folder that heave train has written"),
        ("zoo measure --bogus none", "unrecognized arguments: --bogus"),
        (f"zoo measure {NAME} --seas 1", "at least 2 seas"),
        (f"zoo measure {NAME} --rivals lqgg --seas 2", "did you mean 'lqg'"),
    ],
)
def test_what_is_wrong_is_told_in_a_sentence(capsys, tmp_path, line, words):
    assert words in refused(capsys, *line.replace("OUT", str(tmp_path / "out")).split())
    assert not (tmp_path / "out").exists()


def test_damaged_files_are_told_in_a_sentence(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(zoo, "FOLDER", tmp_path / "zoo")
    zoo.add([run_folder(tmp_path / "run", 0)])
    card = tmp_path / "zoo" / NAME / "card.json"
    weights = card.parent / "0" / "policy.safetensors"
    whole = weights.read_bytes()
    weights.write_bytes(whole[:-4])
    assert "cut short or changed" in refused(capsys, "evaluate", f"zoo:{NAME}")
    weights.write_bytes(whole)
    card.write_text(card.read_text().replace('"wall_s": 1.5', '"wall_s": 0.5'))
    for line in (["zoo", "list"], ["zoo", "show", NAME], ["evaluate", f"zoo:{NAME}"]):
        assert "was changed; restore it" in refused(capsys, *line)
