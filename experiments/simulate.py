"""One run of one sea as a CSV file that users' own scripts read."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

from experiments import runs
from experiments.compare import controller_of
from experiments.rollout import FIRST_TEST_SEED, Trajectory, rollout, with_duration
from heave_env.controller import Controller, NoControl
from heave_env.parameters import PayOut
from heave_env.provenance import provenance
from heave_env.scenarios import Scenario, to_mapping
from heave_env.sea import read_motion

COLUMNS = (
    "time",
    "boom_tip_heave",
    "winch_displacement",
    "payload_heave",
    "sheave_tension",
    "payload_tension",
    "length",
)
"""Columns of the file, SI, heave positive up; `docs/files.md` defines each."""


def with_motion(scenario: Scenario, path: str | Path, duration: float | None = None) -> Scenario:
    """The scenario with its boom tip moved by a motion file in place of sea and vessel.

    Args:
        scenario: The operation.
        path: Motion file: CSV with columns time, heave and optionally payout.
        duration: Length of the run [s]; None: what the file covers in whole control steps.

    Raises:
        ValueError: If the file cannot be used, or covers no control step or less than `duration`.
    """
    recording = read_motion(path)
    covered = float(recording.time[-1] - recording.time[0])
    n_steps = math.floor(covered / scenario.control_dt + 1e-6)
    if n_steps < 1:
        raise ValueError(
            f"motion file {str(path)!r} lasts {covered:g} s, less than one control step of "
            f"{scenario.control_dt:g} s; give a longer one"
        )
    if duration is not None and duration > covered + 1e-9:
        raise ValueError(
            f"motion file {str(path)!r} lasts {covered:g} s, the run {duration:g} s: give a shorter duration "
            "or a longer file"
        )
    sea = dataclasses.replace(scenario.sea_state, kind="recorded", recording=str(Path(path).resolve()))
    recorded = dataclasses.replace(
        scenario,
        sea_state=sea,
        vessel=None,
        vessel_table=None,
        pay_out=scenario.pay_out if recording.payout is None else PayOut(),
        start="hanging",
        duration=round(n_steps * scenario.control_dt, 9),
    )
    return with_duration(recorded, duration)


def simulate(
    scenario: Scenario,
    *,
    out: str | Path,
    controller: str = "none",
    seed: int = FIRST_TEST_SEED,
    motion: str | Path | None = None,
    duration: float | None = None,
    allow_other_scenario: bool = False,
    arguments: list[str] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Trajectory:
    """Runs one sea and writes it; an existing file is replaced only when the run has succeeded.

    Args:
        scenario: The operation.
        out: The CSV file.
        controller: Name of a design, `agent:RUN`, or `zoo:NAME` or `zoo:NAME/SEED`.
        seed: Seed of the sea, its sensors and its initial state.
        motion: Motion file that moves the boom tip in place of sea and vessel.
        duration: Length of the run [s]; None: the scenario's, or what the motion file covers.
        allow_other_scenario: Whether an agent may act in a scenario it was not trained for.
        arguments: Command line of the provenance; None: the process's own.
        progress: Called after each control step with 1.

    Returns:
        What was recorded.

    Raises:
        ValueError: If anything asked for is impossible.
    """
    out = runs.check_file(out)
    if motion is not None:
        scenario = with_motion(scenario, motion, duration)
    # A design, and a policy's scenario, know nothing of how long this one run lasts.
    acting: Controller = NoControl()
    if controller == "none":
        # Without a controller the winch stays at zero, from the first instant on.
        scenario = dataclasses.replace(scenario, start="hanging")
    else:
        acting = controller_of(controller, scenario, allow_other_scenario=allow_other_scenario)
    scenario = with_duration(scenario, duration)
    trajectory = rollout(scenario, acting, [seed], progress=progress)
    runs.write_text(out, file_text(scenario, trajectory, controller, arguments))
    return trajectory


def early_end(trajectory: Trajectory) -> str | None:
    """How and when the first sea ended before its time, or None."""
    for name, ended in trajectory.outcomes.items():
        if ended[0]:
            return f"{name} at {trajectory.n_valid[0] * trajectory.control_dt:g} s"
    return None


def file_text(
    scenario: Scenario, trajectory: Trajectory, controller: str, arguments: list[str] | None = None
) -> str:
    """The file's text: provenance, header, one row per control instant from t = 0 to the end."""
    made = provenance(arguments)
    comments = [
        f"heave_env simulation of {scenario.name} (fingerprint {scenario.fingerprint})",
        f"seed: {trajectory.seeds[0]}",
        f"controller: {controller}",
        "versions: " + ", ".join(f"{name} {version}" for name, version in made["versions"].items()),
        f"commit: {made['commit']}",
        f"command: {made['command']}",
        f"date: {made['date']}",
        "units: s, m, N; heave positive up; winch_displacement positive when it raises the cable's top end",
    ]
    ended = early_end(trajectory)
    if ended is not None:
        comments.append(f"ended early: {ended}")
    comments.append("scenario: " + json.dumps(to_mapping(scenario), ensure_ascii=False))
    channels = {"time": trajectory.time} | {name: values[:, 0] for name, values in trajectory.states.items()}
    n_rows = int(trajectory.n_valid[0]) + 1
    rows = ([channels[name][i] if name in channels else None for name in COLUMNS] for i in range(n_rows))
    return runs.table_text(COLUMNS, rows, comments)
