"""A comparison made up of known series, written as `heave compare` writes one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from experiments.metrics import scores, spectrum, window
from experiments.results import Contest, Entry, Outcome, write_contests
from experiments.rollout import FIRST_TEST_SEED, OUTCOMES, Trajectory
from heave_env.controller import NoControl
from heave_env.provenance import provenance
from heave_env.scenarios import load

DT = 0.1


def trajectory(
    heave: np.ndarray,
    boom_tip: np.ndarray | None = None,
    command: np.ndarray | None = None,
    *,
    n_valid: np.ndarray | None = None,
    position_weight: float = 2.0,
    command_weight: float = 3.0,
    cable: bool = True,
) -> Trajectory:
    """A trajectory of given payload heave (n_steps + 1, n_seas) and command (n_steps, n_seas)."""
    n_steps, n_seas = len(heave) - 1, heave.shape[1]
    boom_tip = np.zeros_like(heave) if boom_tip is None else boom_tip
    command = np.zeros((n_steps, n_seas)) if command is None else command
    rest = np.zeros_like(heave)
    states = {
        "payload_heave": heave,
        "payload_heave_rate": rest,
        "boom_tip_heave": boom_tip,
        "boom_tip_heave_rate": rest,
        "winch_displacement": rest,
        "winch_rate": rest,
    }
    quiet = np.zeros((n_steps, n_seas))
    steps = {
        "command": command,
        "position_cost": position_weight * heave[1:] ** 2,
        "command_cost": command_weight * command**2,
        "failure_cost": quiet.copy(),
        "cost": quiet,
        "saturated": quiet,
    }
    if cable:
        states |= {"sheave_tension": rest + 1e5, "payload_tension": rest + 5e4, "length": rest + 900.0}
        steps |= {
            "slack": quiet,
            "tension_min": quiet + 9e4,
            "tension_max": quiet + 1.1e5,
            "winch_power": quiet,
            "supply_power": quiet,
        }
    return Trajectory(
        seeds=tuple(range(FIRST_TEST_SEED, FIRST_TEST_SEED + n_seas)),
        control_dt=DT,
        states=states,
        steps=steps,
        n_valid=np.full(n_seas, n_steps) if n_valid is None else n_valid,
        outcomes={name: np.zeros(n_seas, dtype=bool) for name in OUTCOMES},
    )


def comparison(folder: Path, n_seas: int = 8) -> Path:
    """Writes a comparison of three controllers on made-up seas, without its page."""
    rng = np.random.default_rng(5)
    scenario = load("sea_state_5")
    time = np.arange(4001) * DT
    phase = rng.uniform(0.0, 6.28, (2, n_seas))
    size = 0.25 * (1.0 + 0.1 * rng.standard_normal(n_seas))
    boom_tip = size * (np.sin(0.6 * time[:, None] + phase[0]) + 0.5 * np.sin(0.9 * time[:, None] + phase[1]))
    part = window(400.0, DT)
    outcomes = []
    locked = None
    for label, left, effort in (("none", 1.4, 0.0), ("lqg", 0.03, 1.0), ("agent:ppo", 0.05, 0.97)):
        noise = 0.005 * left * rng.standard_normal(boom_tip.shape)
        run = trajectory(left * boom_tip + noise, boom_tip, -effort * boom_tip[:-1], position_weight=1e4)
        locked = locked or run
        spectra = {}
        for channel in ("payload_heave", "boom_tip_heave"):
            omega, spectra[channel] = spectrum(run, part, channel)
        entry = Entry(label, label, NoControl(), "sensors_history" if "agent" in label else "sensors")
        outcomes.append(
            Outcome(
                entry=entry,
                values=scores(run, part, locked),
                ends=run.outcomes,
                sample=run.selected(2),
                omega=omega,
                spectra=spectra,
                optimal_cost=None,
            )
        )
    seeds = range(FIRST_TEST_SEED, FIRST_TEST_SEED + n_seas)
    contest = Contest(scenario, part, outcomes)
    write_contests(folder, [contest], seeds, "float64", "lqg", provenance(["compare", "sea_state_5"]))
    return folder
