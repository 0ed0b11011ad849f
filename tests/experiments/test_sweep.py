"""Sweeps: files that are refused, trainings through Ray, what is killed in the middle, and a search."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("stable_baselines3")

from agents.presets import kinds_of
from agents.run_folder import FolderInUse, sole_user
from agents.train import train
from experiments import cli, runs
from experiments.sweep import COLUMNS, TABLE_FILE, sweep
from experiments.sweep_file import cells_of, read_sweep, resolved
from heave_env import scenarios

ROOT = Path(__file__).resolve().parents[2]
NAME = "thesis_linear"
QUICK: dict[str, Any] = {
    "information_set": "sensors",
    "reference": None,
    "warm_start": False,
    "n_envs": 4,
    "hidden": [8],
    "critic_hidden": [8],
    "burn_in": 1.0,
    "mean_life": 200,
    "evaluate_every": 512,
    "evaluation_seas": 2,
    "evaluation_duration": 4.0,
    "options": {"n_steps": 32, "n_minibatches": 2},
}
STEPS = 6144
ENTRY: dict[str, Any] = {"scenarios": [NAME], "seeds": [0, 1], "overrides": QUICK}
RATE = {"low": 1e-4, "high": 1e-2, "log": True}
SEARCH: dict[str, Any] = {
    "scenario": NAME,
    "overrides": QUICK,
    "trials": 2,
    "sampler_seed": 3,
    "parameters": {
        "learning_rate": RATE,
        "hidden": {"choices": [[4], [8]]},
        "options.log_std_init": {"low": -2.0, "high": 0.0},
        "options.n_epochs": {"low": 1, "high": 3, "integer": True},
    },
}


def written(folder: Path, **content: Any) -> Path:
    path = folder / "sweep.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def whole(folder: Path, seed: int, steps: int = STEPS) -> Path:
    """The same training, alone and uninterrupted."""
    settings = resolved(scenarios.load(NAME), "ppo", "sensors", QUICK, steps).to_mapping()
    del settings["algorithm"]
    return train(NAME, seed=seed, out=folder / f"whole_{seed}", preset=settings, progress=False)


def same_policy(one: Path, other: Path) -> bool:
    names = ("policy.safetensors", "policy.json", "checkpoints/policy-final.safetensors")
    return all((one / name).read_bytes() == (other / name).read_bytes() for name in names)


# Files -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({}, "a sweep must have runs or a search; give one of the two keys"),
        ({"run": [ENTRY]}, "unknown key 'run'; did you mean 'runs'?"),
        ({"runs": [{"seeds": [0]}]}, r"missing key 'runs\[0\].scenarios'"),
        ({"runs": [ENTRY | {"scenarios": ["thesis_liner"]}]}, "did you mean 'thesis_linear'"),
        ({"runs": [ENTRY | {"scenarios": []}]}, "scenarios must be a list with at least one entry"),
        (
            {"runs": [ENTRY | {"algorithms": ["dqn"]}]},
            "algorithm must be one of ppo, recurrent_ppo, sac, td3, tqc, got",
        ),
        ({"runs": [ENTRY | {"algorithms": ["sac"], "kinds": ["estimate"]}]}, "kind of sac must be one of"),
        ({"runs": [ENTRY | {"seeds": 3}]}, r"runs\[0\].seeds must be a list, got 3"),
        ({"runs": [ENTRY | {"seeds": [-1]}]}, r"runs\[0\]: seed must be a whole number from 0"),
        ({"runs": [ENTRY], "steps": 0}, "steps must be an integer of at least 1, got 0"),
        ({"runs": [ENTRY | {"overrides": {"learning_rat": 1}}]}, "did you mean 'learning_rate'"),
        ({"runs": [ENTRY | {"overrides": {"total_steps": 9}}]}, "give steps beside overrides"),
        ({"runs": [ENTRY | {"overrides": {"gamma": 1.5}}]}, "gamma must be at most 1, got 1.5"),
        ({"runs": [ENTRY | {"overrides": {"options": {"n_epoch": 2}}}]}, "did you mean 'n_epochs'"),
        ({"search": SEARCH | {"trials": 0}}, "trials must be an integer of at least 1, got 0"),
        ({"search": SEARCH | {"parameters": {}}}, "parameters must be a mapping"),
        ({"search": SEARCH | {"parameters": {"gamm": RATE}}}, "did you mean 'gamma'"),
        (
            {"search": SEARCH | {"parameters": {"gamma": {"low": 0.9, "high": 1.2}}}},
            "search.parameters.gamma: 1.2 is impossible",
        ),
        (
            {"search": SEARCH | {"parameters": {"gamma": {"low": 0.9}}}},
            "search.parameters.gamma.low must be given together with high",
        ),
        (
            {"search": SEARCH | {"parameters": {"n_envs": RATE | {"low": 8, "high": 16}}}},
            "give integer: true",
        ),
        (
            {"search": SEARCH | {"parameters": {"learning_rate": RATE | {"low": 0.0}}}},
            "search.parameters.learning_rate.low must be positive where log is true",
        ),
    ],
)
def test_bad_files_are_refused(tmp_path, content, message):
    with pytest.raises(ValueError, match=message) as refused:
        sweep(written(tmp_path, **content), out=tmp_path / "out", workers=1)
    assert "\n" not in str(refused.value) and "sweep.yaml" in str(refused.value)
    assert not (tmp_path / "out").exists()


def test_the_command_refuses_in_one_sentence(tmp_path, capsys):
    path = written(tmp_path, runs=[ENTRY | {"seeds": ["a"]}])
    assert cli.main(["sweep", str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("heave: ") and said.count("\n") == 1
    assert "runs[0].seeds[0] must be a whole number, got 'a'" in said


def test_a_missing_package_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"'ray': install heave-env\[sweep\] or give --workers 1"):
        sweep(written(tmp_path, runs=[ENTRY]), out=tmp_path / "out", workers=2)
    with pytest.raises(ValueError, match=r"'optuna': install heave-env\[sweep\]"):
        sweep(written(tmp_path, search=SEARCH), out=tmp_path / "out", workers=1)


def test_every_combination_is_a_training_of_its_own_once(tmp_path):
    kinds = kinds_of("ppo")
    entry = {"scenarios": [NAME, "sea_state_5"], "kinds": ["sensors", *kinds], "seeds": [0, 4]}
    again = {"scenarios": [NAME], "seeds": [4, 5]}
    cells = cells_of(read_sweep(written(tmp_path, steps=1000, runs=[entry, again])))
    assert len(cells) == len({cell.folder for cell in cells}) == 2 * (1 + len(kinds)) * 2 + 1
    assert {cell.preset.total_steps for cell in cells} == {1000}
    guided = {cell.kind: cell.preset.guide_mode for cell in cells if cell.preset.guide is not None}
    assert guided == {kind: kind for kind in kinds}


def test_numbers_without_a_point_are_numbers(tmp_path):
    path = tmp_path / "sweep.yaml"
    path.write_text(
        "steps: 2e5\nruns: [{scenarios: [thesis_linear], overrides: {learning_rate: 1e-4}}]", encoding="utf-8"
    )
    (cell,) = cells_of(read_sweep(path))
    assert (cell.preset.total_steps, cell.preset.learning_rate) == (200_000, 1e-4)


# In this process ---------------------------------------------------------------------------------


def test_one_worker_needs_no_ray_and_skips_what_is_finished(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    path = written(tmp_path, steps=512, runs=[ENTRY])
    found = sweep(path, out=tmp_path / "out", workers=1)
    assert (found.n_run, found.n_skipped, found.failures) == (2, 0, {})
    rows = runs.read_table(tmp_path / "out" / TABLE_FILE)
    assert list(rows[0]) == list(COLUMNS)
    for seed, row in enumerate(rows):
        run = runs.read_json(Path(row["path"]) / "run.json")
        assert (row["scenario"], row["seed"], row["status"]) == (NAME, str(seed), "finished")
        assert float(row["validation_cost"]) == run["best"]["cost_mean"]
        assert json.loads(row["overrides"]) == QUICK
    table = (tmp_path / "out" / TABLE_FILE).read_bytes()
    again = sweep(path, out=tmp_path / "out", workers=1)
    assert (again.n_run, again.n_skipped) == (0, 2)
    assert (tmp_path / "out" / TABLE_FILE).read_bytes() == table


def test_a_training_that_fails_is_told_and_does_not_end_the_others(tmp_path, capsys):
    wild = ENTRY | {"seeds": [0], "overrides": {**QUICK, "learning_rate": 1e12}}
    path = written(tmp_path, steps=512, runs=[wild, ENTRY | {"seeds": [1]}])
    code = cli.main(["sweep", str(path), "--out", str(tmp_path / "out"), "--workers", "1"])
    said = capsys.readouterr()
    assert code == 1 and "stopped being finite" in said.err
    rows = runs.read_table(tmp_path / "out" / TABLE_FILE)
    assert [row["status"] for row in rows] == ["failed", "finished"]
    assert rows[0]["validation_cost"] == ""


def test_two_sweeps_do_not_share_a_folder(tmp_path):
    path = written(tmp_path, steps=512, runs=[ENTRY])
    with sole_user(tmp_path / "out"), pytest.raises(FolderInUse, match="another process"):
        sweep(path, out=tmp_path / "out", workers=1)


# Search ------------------------------------------------------------------------------------------


def test_a_search_goes_on_from_its_file_as_if_it_had_not_stopped(tmp_path, monkeypatch):
    pytest.importorskip("optuna")
    content = {"steps": 512, "search": SEARCH | {"trials": 3, "seeds": [0, 1]}}
    path = written(tmp_path, **content)
    uninterrupted = sweep(path, out=tmp_path / "whole", workers=1)
    assert (uninterrupted.n_run, len(uninterrupted.rows)) == (6, 6)

    # Ctrl-C comes in the middle of the second trial, and again in the third.
    for begun in (3, 5):
        with monkeypatch.context() as patched:
            patched.setattr("experiments.sweep._train", cut_off_at(f"-{begun % 2}", begun // 2))
            with pytest.raises(KeyboardInterrupt):
                sweep(path, out=tmp_path / "parts", workers=1)
    resumed = sweep(path, out=tmp_path / "parts", workers=1)
    assert resumed.n_skipped == 5 and resumed.n_run == 1

    def told(rows: list[dict[str, Any]]) -> list[Any]:
        return [(row["trial"], row["seed"], row["overrides"], row["validation_cost"]) for row in rows]

    assert told(resumed.rows) == told(uninterrupted.rows)
    assert resumed.best == uninterrupted.best is not None
    costs = [row["validation_cost"] for row in resumed.rows if row["trial"] == resumed.best["trial"]]
    assert resumed.best["value"] == pytest.approx(sum(costs) / 2)
    settings = {row["overrides"] for row in resumed.rows}
    assert len(settings) == 3

    with pytest.raises(ValueError, match="holds a search with another sampler_seed; give another folder"):
        sweep(
            written(tmp_path, steps=512, search=content["search"] | {"sampler_seed": 4}),
            out=tmp_path / "parts",
            workers=1,
        )


def cut_off_at(suffix: str, trial: int) -> Callable[..., None]:
    from experiments import sweep as module

    proper = module._train

    def cut_off(cell: Any, folder: Path, *arguments: Any) -> None:
        if cell.trial == trial and folder.name.endswith(suffix):
            raise KeyboardInterrupt
        proper(cell, folder, *arguments)

    return cut_off


def test_an_address_where_nobody_listens_is_refused_at_once(tmp_path):
    pytest.importorskip("ray")
    with socket.socket() as unheard:  # bound, so that nobody else takes it, and not listening
        unheard.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{unheard.getsockname()[1]}"
        with pytest.raises(ValueError, match="no Ray cluster answers at --address"):
            sweep(written(tmp_path, runs=[ENTRY]), out=tmp_path / "out", address=address)


# Through Ray -------------------------------------------------------------------------------------


def descendants(names: str) -> list[int]:
    """Processes below this one whose command line holds some text."""
    parents, found = {}, []
    for entry in Path("/proc").iterdir():
        with contextlib.suppress(OSError, ValueError):
            number = int(entry.name)
            parents[number] = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            if names in (entry / "cmdline").read_bytes().decode(errors="replace"):
                found.append(number)

    def below(number: int) -> bool:
        while number in parents and number != os.getpid():
            number = parents[number]
        return number == os.getpid()

    return [number for number in found if number != os.getpid() and below(number)]


@contextlib.contextmanager
def meanwhile(action: Callable[[], bool]) -> Iterator[list[bool]]:
    """Tries an action every few milliseconds in a thread until it says that it is done."""
    stop, done = threading.Event(), list[bool]()

    def keep_trying() -> None:
        while not stop.wait(0.005):
            if action():
                done.append(True)
                return

    thread = threading.Thread(target=keep_trying)
    thread.start()
    try:
        yield done
    finally:
        stop.set()
        thread.join()


def under_way(out: Path, seed: int) -> Path | None:
    """The run folder of a training that has saved a state and is not finished."""
    return next((path.parents[1] for path in out.glob(f"cells/*-{seed}-*/resume/state.json")), None)


def test_a_killed_worker_s_training_is_run_again_to_the_same_bits(tmp_path):
    pytest.importorskip("ray")
    out = tmp_path / "out"

    def kill_the_worker() -> bool:
        folder = under_way(out, 0)
        if folder is None:
            return False
        workers = descendants(f"ray::{folder.name}")
        for number in workers:
            os.kill(number, signal.SIGKILL)
        return bool(workers)

    path = written(tmp_path, steps=STEPS, runs=[ENTRY])
    with meanwhile(kill_the_worker) as killed:
        found = sweep(path, out=out, workers=2, save_every=0.0)
    assert killed, "the training ended before its worker could be killed"
    assert (found.workers, found.n_run, found.failures) == (2, 2, {})
    assert same_policy(Path(found.rows[0]["path"]), whole(tmp_path, 0))
    assert descendants("raylet") == descendants("gcs_server") == []


@pytest.mark.slow
def test_a_killed_node_s_trainings_are_run_again_elsewhere(tmp_path, monkeypatch):
    ray = pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    out = tmp_path / "out"
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    try:
        nodes = [cluster.add_node(num_cpus=1, object_store_memory=80 * 2**20) for _ in range(2)]
        cluster.wait_for_nodes()

        def kill_a_node() -> bool:
            if under_way(out, 0) is None or under_way(out, 1) is None:
                return False
            cluster.remove_node(nodes.pop(), allow_graceful=False)
            return True

        steps = 4 * STEPS
        path = written(tmp_path, steps=steps, runs=[ENTRY])
        with meanwhile(kill_a_node) as killed:
            found = sweep(path, out=out, address=cluster.address, save_every=0.0)
        assert killed, "the trainings ended before a node could be killed"
        assert (found.workers, found.n_run, found.failures) == (2, 2, {})
        for seed, row in enumerate(found.rows):
            assert same_policy(Path(row["path"]), whole(tmp_path, seed, steps))
    finally:
        ray.shutdown()
        cluster.shutdown()


@pytest.mark.slow
def test_an_interruption_saves_and_the_same_command_goes_on(tmp_path):
    pytest.importorskip("ray")
    out, steps = tmp_path / "out", 20 * STEPS
    path = written(tmp_path, steps=steps, runs=[ENTRY])
    command = [
        sys.executable,
        "-m",
        "experiments.cli",
        "sweep",
        str(path),
        "--out",
        str(out),
        "--workers",
        "2",
    ]
    # Ctrl-C reaches the whole process group, as on a terminal.
    process = subprocess.Popen(command, cwd=ROOT, start_new_session=True, stderr=subprocess.PIPE, text=True)

    def begun() -> bool:
        return len(list(out.glob("cells/*/progress.csv"))) == 2

    deadline = time.monotonic() + 120.0
    while not begun() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=120.0)[1]
    assert process.returncode == 130 and "the same command goes on from there" in said
    states = [runs.read_json(place) for place in out.glob("cells/*/run.json")]
    assert [state["status"] for state in states] == ["interrupted"] * 2
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300.0, check=False)
    assert done.returncode == 0, done.stderr
    for seed, row in enumerate(runs.read_table(out / TABLE_FILE)):
        assert same_policy(Path(row["path"]), whole(tmp_path, seed, steps))


@pytest.mark.slow
def test_how_many_trainings_per_minute_one_and_two_workers_do(tmp_path, capsys):
    """Prints the figures; on crowded processors two workers gain less than on two of their own."""
    pytest.importorskip("ray")
    path = written(tmp_path, steps=20 * STEPS, runs=[ENTRY | {"seeds": [0, 1, 2, 3]}])
    speeds = [sweep(path, out=tmp_path / str(workers), workers=workers).speed for workers in (1, 2)]
    with capsys.disabled():
        print("\n" + "\n".join(speeds) + f"\nload {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    policies = [sorted((tmp_path / name).glob("cells/*")) for name in ("1", "2")]
    assert len(policies[0]) == 4
    assert all(same_policy(one, other) for one, other in zip(*policies, strict=True))
