"""The CSV of `heave simulate` holds what its columns are defined to hold."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from experiments.simulate import COLUMNS, simulate, with_motion
from heave_env.scenarios import from_mapping, load, with_value


def columns_of(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    assert tuple(rows[0]) == COLUMNS
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in COLUMNS}


def motion_file(path: Path, *, until: float = 20.0, step: float = 0.1, payout: float | None = None) -> Path:
    time = np.arange(round(until / step) + 1) * step
    heave = 0.5 * np.sin(0.6 * time) + 0.2
    header = "time,heave" + ("" if payout is None else ",payout")
    lines = ["# a recorded motion", header]
    for t, z in zip(time, heave, strict=True):
        lines.append(f"{t:.12g},{z:.17g}" + ("" if payout is None else f",{payout * t:.17g}"))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def motion(tmp_path):
    return motion_file(tmp_path / "motion.csv")


def test_in_a_calm_sea_the_payload_hangs_still(tmp_path):
    scenario = with_value(load("sea_state_5"), "sea_state.kind", "calm")
    simulate(scenario, out=tmp_path / "out.csv", duration=60.0)
    found = columns_of(tmp_path / "out.csv")
    assert np.abs(found["payload_heave"]).max() < 1e-9
    assert np.abs(found["boom_tip_heave"]).max() == 0.0
    assert found["sheave_tension"] == pytest.approx(scenario.static_tension, rel=1e-9)
    assert found["payload_tension"] == pytest.approx(scenario.payload.submerged_weight, rel=1e-9)
    assert found["length"] == pytest.approx(900.0, abs=0)


@pytest.mark.parametrize("name", ["thesis_regulator", "thesis_cable"])
def test_a_recorded_motion_moves_the_boom_tip(tmp_path, motion, name):
    simulate(load(name), out=tmp_path / "out.csv", motion=motion)
    found = columns_of(tmp_path / "out.csv")
    assert found["time"] == pytest.approx(np.arange(201) * 0.1, abs=1e-9)
    assert found["boom_tip_heave"] == pytest.approx(0.5 * np.sin(0.6 * found["time"]) + 0.2, abs=1e-9)


def test_a_run_starts_in_static_equilibrium_below_the_first_sample(tmp_path, motion):
    simulate(load("thesis_cable"), out=tmp_path / "out.csv", motion=motion)
    assert columns_of(tmp_path / "out.csv")["payload_heave"][0] == pytest.approx(0.2, abs=1e-9)


@pytest.mark.parametrize("controller", ["none", "lqr"])
def test_length_is_initial_plus_payout_minus_winch_displacement(tmp_path, controller):
    motion = motion_file(tmp_path / "motion.csv", payout=0.5)
    simulate(load("thesis_cable"), out=tmp_path / "out.csv", motion=motion, controller=controller)
    found = columns_of(tmp_path / "out.csv")
    expected = 900.0 + 0.5 * found["time"] - found["winch_displacement"]
    assert found["length"] == pytest.approx(expected, abs=1e-9)
    assert np.any(found["winch_displacement"] != 0.0) == (controller == "lqr")


def test_payout_does_not_move_the_payload_heave(tmp_path):
    still = tmp_path / "still.csv"
    lines = ["time,heave,payout"] + [f"{t},0.0,{0.01 * t}" for t in range(61)]
    still.write_text("\n".join(lines), encoding="utf-8")
    simulate(load("thesis_cable"), out=tmp_path / "out.csv", motion=still)
    found = columns_of(tmp_path / "out.csv")
    # What is left is the start's jerk: 0.01 m/s for half a natural period of 17 s, in fractions.
    assert np.abs(found["payload_heave"]).max() < 0.05
    assert found["length"][-1] == pytest.approx(900.6)


def test_a_file_that_covers_no_whole_step_at_its_end_loses_the_rest(tmp_path):
    motion = motion_file(tmp_path / "motion.csv", until=10.0, step=0.08)
    scenario = with_motion(load("thesis_cable"), motion)
    assert scenario.duration == 10.0
    motion = motion_file(tmp_path / "motion.csv", until=9.92, step=0.08)
    assert with_motion(load("thesis_cable"), motion).duration == 9.9


def test_a_duration_shortens_a_motion_file_but_cannot_outlast_it(tmp_path, motion):
    trajectory = simulate(load("thesis_cable"), out=tmp_path / "out.csv", motion=motion, duration=5.0)
    assert trajectory.time[-1] == 5.0
    with pytest.raises(ValueError, match="lasts 20 s, the run 30 s"):
        simulate(load("thesis_cable"), out=tmp_path / "out.csv", motion=motion, duration=30.0)


def test_a_motion_file_stands_in_for_sea_and_vessel(motion):
    scenario = with_motion(load("sea_state_5"), motion)
    assert scenario.vessel is None
    assert scenario.sea_state.kind == "recorded"


def test_a_linear_plant_leaves_tension_and_length_blank(tmp_path):
    simulate(load("thesis_linear"), out=tmp_path / "out.csv", duration=1.0)
    last = (tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()[-1]
    assert last.endswith(",,,")


def test_pay_out_of_the_operation_runs_without_a_controller(tmp_path):
    scenario = load("lowering")
    paying = scenario.pay_out
    simulate(scenario, out=tmp_path / "out.csv", duration=paying.start + 25.0)
    found = columns_of(tmp_path / "out.csv")
    assert found["length"][round(paying.start / 0.1)] == pytest.approx(scenario.initial_length)
    # Once up to speed, five seconds pay out five times the speed.
    assert found["length"][-1] - found["length"][-51] == pytest.approx(5.0 * paying.speed)
    assert not found["winch_displacement"].any()


def test_the_file_says_where_it_comes_from_and_gives_the_scenario_back(tmp_path):
    scenario = load("thesis_linear")
    simulate(scenario, out=tmp_path / "out.csv", duration=1.0, seed=7, arguments=["simulate", "x"])
    comments = [
        line[2:] for line in (tmp_path / "out.csv").read_text(encoding="utf-8").splitlines() if line[0] == "#"
    ]
    said = dict(line.split(": ", 1) for line in comments if ": " in line)
    assert {"seed", "controller", "versions", "commit", "command", "date", "scenario"} <= set(said)
    assert said["seed"] == "7"
    assert said["command"] == "heave simulate x"
    again = from_mapping(json.loads(said["scenario"]))
    assert again.sensors == scenario.sensors
    assert again.duration == 1.0


def test_a_lost_payload_ends_the_file_and_is_said(tmp_path):
    scenario = with_value(load("snap"), "cable.breaking_strength", 20_000.0)
    trajectory = simulate(scenario, out=tmp_path / "out.csv", duration=30.0)
    text = (tmp_path / "out.csv").read_text(encoding="utf-8")
    assert trajectory.outcomes["lost"][0]
    assert "# ended early: lost at" in text
    assert len(columns_of(tmp_path / "out.csv")["time"]) == trajectory.n_valid[0] + 1


def test_the_same_command_gives_the_same_numbers(tmp_path):
    for name in ("a.csv", "b.csv"):
        simulate(load("sea_state_5"), out=tmp_path / name, duration=2.0, controller="lqg", seed=11)
    first, second = (columns_of(tmp_path / name) for name in ("a.csv", "b.csv"))
    assert all(np.array_equal(first[name], second[name]) for name in COLUMNS)
