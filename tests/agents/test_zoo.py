"""The zoo's files: what enters, what comes back, what is refused; and the agents that are shipped."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from agents import zoo
from agents.policy import TrainedPolicy, canonical, load_policy, save_policy, sha256
from agents.train import train, validation
from baselines.oracle import oracle
from experiments.rollout import rollout
from heave_env import scenarios

ROOT = Path(__file__).resolve().parents[2]
LINEAR = scenarios.load("thesis_linear")
PRESET = {
    "information_set": "sensors",
    "reference": None,
    "warm_start": False,
    "n_envs": 8,
    "hidden": [8],
    "critic_hidden": [8],
    "total_steps": 2048,
    "burn_in": 1.0,
    "mean_life": 200,
    "evaluate_every": 1024,
    "evaluation_seas": 2,
    "evaluation_duration": 4.0,
    "learning_rate": 1e-3,
    "options": {"n_steps": 32, "n_minibatches": 2, "log_std_init": -1.0},
}
NAME = "thesis_linear-sensors"


def trained(folder: Path, seed: int = 0, scenario=LINEAR, **changes) -> Path:
    return train(scenario, seed=seed, out=folder, preset={**PRESET, **changes}, progress=False)


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> dict[str, Path]:
    """Two seeds of one recipe, and one of another."""
    folder = tmp_path_factory.mktemp("runs")
    found = {str(seed): trained(folder / str(seed), seed) for seed in (0, 1)}
    found["other"] = trained(folder / "other", 2, gamma=0.9)
    return found


@pytest.fixture
def empty(tmp_path, monkeypatch) -> Path:
    monkeypatch.setattr(zoo, "FOLDER", tmp_path / "zoo")
    return tmp_path / "zoo"


@pytest.fixture
def filled(empty, runs) -> Path:
    zoo.add([runs["0"], runs["1"]])
    return empty


def refusal(function, *arguments) -> str:
    with pytest.raises(ValueError) as caught:
        function(*arguments)
    text = str(caught.value)
    assert "\n" not in text
    return text


# What enters and comes back ----------------------------------------------------------------------


def as_shipped(name: str, value: np.ndarray) -> np.ndarray:
    return value if name == "features.weight" else value.astype(np.float16)


def rounded(run: Path) -> TrainedPolicy:
    """The run's policy with weights as the zoo's files hold them."""
    policy = load_policy(run)
    weights = {name: as_shipped(name, value) for name, value in policy.weights.items()}
    return TrainedPolicy(policy.architecture, weights, policy.card)


def test_the_files_are_those_of_the_run_in_half_precision(filled, runs):
    assert zoo.names() == (NAME,)
    agent = zoo.read(NAME)
    assert agent.seeds == (0, 1) and agent.specs() == (f"zoo:{NAME}/0", f"zoo:{NAME}/1")
    assert agent.scenario == LINEAR
    for seed in agent.seeds:
        ours, theirs = filled / NAME / str(seed), runs[str(seed)]
        told = [json.loads((place / "policy.json").read_text()) for place in (ours, theirs)]
        hashes = [content.pop("weights_sha256") for content in told]
        assert told[0] == told[1] and hashes[0] != hashes[1]
        weights, trained = (load_policy(place, LINEAR).weights for place in (ours, theirs))
        for key in trained:
            np.testing.assert_array_equal(weights[key], as_shipped(key, trained[key]))
        sizes = [(place / "policy.safetensors").stat().st_size for place in (ours, theirs)]
        values = sum(value.size for key, value in trained.items() if key != "features.weight")
        assert sizes[0] <= sizes[1] - 2 * values
    found = {path.relative_to(filled).as_posix() for path in filled.rglob("*") if path.is_file()}
    each = {f"{NAME}/{seed}/policy.{suffix}" for seed in (0, 1) for suffix in ("json", "safetensors")}
    assert found == {f"{NAME}/card.json", *each}
    assert agent.size == sum((filled / name).stat().st_size for name in found)


def test_an_agent_of_the_zoo_acts_as_its_rounded_weights_do(filled, runs):
    for seed in (0, 1):
        ours = rollout(LINEAR, zoo.load_agent(f"zoo:{NAME}/{seed}", LINEAR), [5, 6], duration=10.0)
        theirs = rollout(LINEAR, rounded(runs[str(seed)]), [5, 6], duration=10.0)
        np.testing.assert_array_equal(ours.steps["command"], theirs.steps["command"])


def test_weights_that_half_precision_cannot_hold_stay_out(empty, runs, tmp_path):
    policy = load_policy(runs["0"], LINEAR)
    weights = {**policy.weights, "output.bias": np.array([7e4], dtype=np.float32)}
    shutil.copytree(runs["0"], tmp_path / "run")
    save_policy(tmp_path / "run" / "policy.json", TrainedPolicy(policy.architecture, weights, policy.card))
    assert "output.bias reaches 70000, too much for float16" in refusal(zoo.add, [tmp_path / "run"])
    assert zoo.names() == ()


def test_without_a_seed_it_is_the_training_that_validates_best(filled, runs):
    costs = {
        seed: json.loads((runs[str(seed)] / "run.json").read_text())["best"]["cost_mean"] for seed in (0, 1)
    }
    best = min(costs, key=costs.get)
    assert zoo.read(NAME).best == best
    assert zoo.policy_folder(f"zoo:{NAME}") == filled / NAME / str(best)


def test_the_card_tells_how_it_was_trained(filled, runs):
    card = zoo.read(NAME).card
    run = json.loads((runs["1"] / "run.json").read_text())
    told = card["trainings"]["1"]
    for key in ("steps", "wall_s", "commit", "versions", "start", "best", "finished"):
        assert told[key] == run[key], key
    assert told["command"] == zoo._anywhere(run["command"])
    assert card["preset"] == run["preset"] and card["fingerprint"] == run["fingerprint"]
    assert card["agent"] == "sensors" and card["guide"] is None and card["information_set"] == "sensors"
    curve = np.loadtxt(runs["1"] / "evaluations.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(told["curve"]["step"], curve[:, 0])
    assert sha256((runs["1"] / "policy.safetensors").read_bytes()) == told["weights_sha256"]


def test_the_printed_command_trains_the_same_weights_again(filled, tmp_path):
    command = zoo.read(NAME).command(1)
    found = re.fullmatch(
        r"heave train thesis_linear --algorithm ppo --preset (\S+) --seed 1 --out DIR", command
    )
    assert found is not None
    again = train(LINEAR, seed=1, out=tmp_path / "again", preset=zoo.preset_of(found[1]), progress=False)
    told = zoo.read(NAME).training(1)
    assert sha256((again / "policy.safetensors").read_bytes()) == told["weights_sha256"]
    assert "seed 1 already" in refusal(zoo.add, [again])


def test_seeds_may_come_one_by_one_and_at_once(empty, runs):
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda seed: zoo.add([runs[seed]]), ("0", "1")))
    assert zoo.read(NAME).seeds == (0, 1)
    zoo.add([runs["other"]], "another-gamma")
    assert zoo.names() == ("another-gamma", NAME)


@pytest.mark.parametrize(
    ("guide", "preset", "kind"),
    [
        (None, {}, "sensors"),
        ({"mode": "rate"}, {}, "rate"),
        ({"mode": "rate"}, {"guide_shown": True}, "rate"),
        ({"mode": "rate"}, {"guide_shown": False}, "sensors"),
    ],
)
def test_a_kind_is_what_the_agent_sees(guide, preset, kind):
    policy: Any = SimpleNamespace(card={"guide": guide})
    assert zoo.Run(Path("run"), {"preset": preset}, policy).kind == kind


@pytest.mark.parametrize(
    ("scenario", "guide", "mode"),
    [
        ("thesis_linear", "lqg", "residual"),
        ("thesis_linear", "mpc", "estimate"),
        # Tuned, which takes some twenty seconds.
        pytest.param("limits_linear", "mpc", "residual", marks=pytest.mark.slow),
    ],
)
def test_a_guided_agent_acts_from_the_zoo_as_from_its_run(empty, tmp_path, scenario, guide, mode):
    chosen = scenarios.load(scenario)
    changes = {"guide": guide, "guide_mode": mode, "warm_start": mode == "estimate", "excitation": 0.02}
    run = trained(tmp_path / "run", 3, chosen, **changes)
    agent = zoo.add([run])
    assert agent.name == f"{scenario}-{mode}"
    assert agent.card["guide"] == guide and agent.training(3)["guide"]["mode"] == mode
    there = scenarios.load(f"{scenario}@rougher")
    ours = rollout(there, zoo.load_agent(agent.name, there), [5, 6], duration=10.0)
    theirs = rollout(there, rounded(run), [5, 6], duration=10.0)
    np.testing.assert_array_equal(ours.steps["command"], theirs.steps["command"])


def test_a_fresh_process_loads_it_without_torch(filled):
    code = (
        "import sys, numpy as np; from agents.zoo import load_agent; "
        f"policy = load_agent('zoo:{NAME}'); policy.predict(np.zeros((3, 2), dtype=np.float32)); "
        "print([name for name in ('torch', 'stable_baselines3', 'pickle5') if name in sys.modules])"
    )
    given = {**os.environ, "HEAVE_ZOO": str(filled)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, env=given, check=False
    )
    assert done.stdout.strip() == "[]", done.stderr


# What is refused ---------------------------------------------------------------------------------


def test_unknown_names_are_told_in_a_sentence(filled):
    assert f"did you mean '{NAME}'?" in refusal(zoo.read, "thesis_linear-sensor")
    assert "heave zoo list" in refusal(zoo.load_agent, "zoo:zzz")
    assert "no training of seed 7; seeds: 0, 1" in refusal(zoo.load_agent, f"zoo:{NAME}/7")
    for odd in ("zoo:", f"zoo:{NAME}/", f"zoo:{NAME}/one"):
        assert "write zoo:NAME" in refusal(zoo.specs_of, odd)
    assert "no agent '../zoo'" in refusal(zoo.read, "../zoo")


def test_another_scenario_is_refused_unless_allowed(filled):
    other = scenarios.with_value(LINEAR, "winch.command_delay", 0.4)
    told = refusal(zoo.load_agent, f"zoo:{NAME}", other)
    assert "was trained in scenario 'thesis_linear'" in told and "allow another" in told


def damaged_cards(text: str) -> dict[str, str]:
    card = json.loads(text)
    other = {**card, "name": "other"}
    other["card_sha256"] = sha256(canonical({k: v for k, v in other.items() if k != "card_sha256"}))
    return {
        "cut short or damaged": text[: len(text) // 2],
        "was changed": json.dumps({**card, "scenario_name": "sea_state_5"}),
        "is not a card": json.dumps({**card, "format": "another"}),
        "is of the agent 'other'": json.dumps(other),
    }


@pytest.mark.parametrize(
    "words", ["cut short or damaged", "was changed", "is not a card", "is of the agent 'other'"]
)
def test_a_damaged_card_is_refused(filled, words):
    path = filled / NAME / "card.json"
    path.write_text(damaged_cards(path.read_text())[words])
    assert words in refusal(zoo.read, NAME)


def test_damaged_and_swapped_policies_are_refused(filled):
    spec, place = f"zoo:{NAME}/0", filled / NAME / "0"
    kept = {path.name: path.read_bytes() for path in place.iterdir()}

    def with_files(**changed: bytes) -> str:
        for name, content in {**kept, **changed}.items():
            (place / name).write_bytes(content)
        return refusal(zoo.load_agent, spec)

    weights = kept["policy.safetensors"]
    assert "cut short" in with_files(**{"policy.safetensors": weights[:-7]})
    assert "changed" in with_files(**{"policy.safetensors": weights[:-1] + bytes([weights[-1] ^ 1])})
    assert "changed" in with_files(**{"policy.json": kept["policy.json"].replace(b"ppo", b"sac")})
    # Another training's files are whole in themselves, but not those that the card names.
    other = {path.name: path.read_bytes() for path in (filled / NAME / "1").iterdir()}
    assert "hash that its card states" in with_files(**other)
    (place / "policy.json").unlink()
    assert "is missing" in refusal(zoo.load_agent, spec)


def test_what_is_no_training_of_the_recipe_stays_out(filled, runs, tmp_path, monkeypatch):
    before = (filled / NAME / "card.json").read_bytes()
    assert "already" in refusal(zoo.add, [runs["0"]])
    told = refusal(zoo.add, [runs["other"]])
    assert "preset.gamma is 0.9, not 0.98" in told and "--name" in told
    assert "preset.gamma" in refusal(zoo.add, [runs["0"], runs["other"]], "new")
    assert "two of the runs" in refusal(zoo.add, [runs["0"], runs["0"]], "new")
    assert "no run folder was named" in refusal(zoo.add, [])
    assert "no run folder that heave train" in refusal(zoo.add, [tmp_path])
    assert "parts joined by -" in refusal(zoo.add, [runs["0"]], "a/b")
    run = tmp_path / "run"
    shutil.copytree(runs["other"], run)
    content = json.loads((run / "run.json").read_text())
    for changes, words in (
        ({"status": "interrupted"}, "not finished"),
        ({"kind": "training on the device"}, "holds a training on the device"),
        ({"seed": 5}, "not of the training"),
        ({"scenario_name": "mine"}, "no scenario by name"),
    ):
        (run / "run.json").write_text(json.dumps(content | changes))
        assert words in refusal(zoo.add, [run], "new"), words
    (run / "run.json").write_text("{}")
    assert "lacks 'kind'" in refusal(zoo.add, [run], "new")
    (run / "run.json").write_text(json.dumps(content))
    (run / "policy.safetensors").write_bytes(b"")
    assert "cut short" in refusal(zoo.add, [run], "new")
    monkeypatch.setattr(zoo, "LARGEST", 10_000)
    assert "more than its 0.01 MB" in refusal(zoo.add, [runs["other"]], "new")
    assert zoo.names() == (NAME,) and (filled / NAME / "card.json").read_bytes() == before


def test_a_training_from_before_a_setting_had_its_default(filled, runs, tmp_path):
    """Settings are added as the program grows; a seed that was trained before is of the same recipe."""
    run = tmp_path / "old"
    shutil.copytree(runs["1"], run)
    shutil.rmtree(filled / NAME)
    content = json.loads((run / "run.json").read_text())
    assert content["preset"].pop("guide_reach") == 0.1
    (run / "run.json").write_text(json.dumps(content))
    assert zoo.add([runs["0"], run]).seeds == (0, 1)
    content["preset"]["guide_reach"] = 0.2
    (run / "run.json").write_text(json.dumps(content))
    assert "preset.guide_reach is 0.2, not 0.1" in refusal(zoo.add, [runs["0"], run], "new")


def test_a_training_in_a_changed_scenario_stays_out(empty, tmp_path):
    changed = scenarios.with_value(LINEAR, "winch.command_delay", 0.4)
    assert "changed 'thesis_linear'" in refusal(zoo.add, [trained(tmp_path / "run", 0, changed)])
    assert zoo.names() == ()


# What is shipped ---------------------------------------------------------------------------------


def test_the_shipped_zoo_is_small_and_plain():
    files = [path for path in (ROOT / "agents" / "zoo").rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < zoo.LARGEST
    assert {path.suffix for path in files} <= {".json", ".safetensors"}
    named = {zoo.FOLDER / name for name in zoo.names()}
    assert {path.relative_to(zoo.FOLDER).parts[0] for path in files} == {path.name for path in named}
    ignored = subprocess.run(
        ["git", "check-ignore", "agents/zoo/a/card.json", "agents/zoo/a/0/policy.safetensors"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert ignored.stdout == ""  # what git ignores the wheel leaves out


def test_every_shipped_agent_is_whole_and_fits_its_scenario():
    for name in zoo.names():
        agent = zoo.read(name)
        assert len(agent.seeds) >= 5, name
        results = agent.card["results"]
        assert results is not None and set(results["trainings"]) == {str(seed) for seed in agent.seeds}, name
        assert agent.scenario.fingerprint == scenarios.load(agent.card["scenario_name"]).fingerprint
        for spec in agent.specs():
            policy = zoo.load_agent(spec, agent.scenario)
            seen = np.zeros((2, len(policy.scenario.observation_names)), dtype=np.float32)
            action, _ = policy.predict(seen, episode_start=np.ones(2, dtype=bool))
            assert action.shape == (2, 1) and np.isfinite(action).all(), spec
            assert all(
                np.array_equal(value, as_shipped(name, value)) for name, value in policy.weights.items()
            )


@pytest.mark.slow
def test_who_sees_sensors_alone_comes_near_who_knows_what_was_drawn():
    """The shipped agents of `unknown_linear` in 256 seas that neither training nor card has seen."""
    scenario, first, n_seas = scenarios.load("unknown_linear"), 10_400_000, 256
    given = {"n_seas": n_seas, "duration": 200.0, "first_sea": first}
    knows = validation(oracle(scenario, range(first, first + n_seas)), scenario, **given)["cost_mean"]
    for spec in zoo.read("unknown_linear-sensors").specs():
        policy = zoo.load_agent(spec, scenario)
        found = validation(policy, policy.scenario, **given)
        print(f"{spec}: {found['cost_mean'] / knows:.3f} of the oracle, largest {found['cost_max']:.3g}")
        assert found["failed"] == 0.0 and found["cost_max"] < 2.0
        assert found["cost_mean"] < 1.3 * knows


@pytest.mark.parametrize("spec", zoo.read("thesis_linear-estimate").specs())
def test_who_sees_the_estimate_holds_its_loop_from_wherever_a_sea_begins(spec):
    """An estimate may begin 180 deviations out: cut off at 60, an agent lost one sea in a thousand."""
    policy = zoo.load_agent(spec)
    found = validation(policy, policy.scenario, n_seas=2000, duration=20.0, first_sea=10_400_000)
    assert found["cost_max"] < 10.0 and found["failed"] == 0.0


def test_a_card_does_not_tell_where_a_training_lay():
    told = zoo._anywhere(
        "heave train limits_linear --preset 'my own.yaml' --out /home/me/all/rate_3 --seed 3"
    )
    assert told == "heave train limits_linear --preset 'my own.yaml' --out runs/rate_3 --seed 3"
    assert zoo._anywhere("heave train snap") == "heave train snap" and zoo._anywhere(None) is None
