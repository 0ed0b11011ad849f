"""How far the peaks of tension on `snap` could be lowered at equal motion, by whatever means."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from scipy.optimize import differential_evolution

from baselines import design
from experiments.metrics import scores, window
from experiments.rollout import FIRST_TEST_SEED, rollout
from heave_env.env import HeaveVectorEnv
from heave_env.scenarios import load

SNAP = load("snap")
N_HARMONICS = 7
SETTLED, SCORED = 300, 300


def periodic(amplitudes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Payload's standard deviation [m] and 99.9 % tension [N] of periodic commands, (n_commands,) each.

    They know the sea's phase: the sea is regular, and its frequency no secret. `amplitudes` are those of
    cosines and sines [m], (2 N_HARMONICS, n_commands).
    """
    n = amplitudes.shape[1]
    time = SNAP.control_dt * (1.0 + np.arange(SETTLED + SCORED))
    phase = SNAP.sea_state.peak_omega * time[:, None] * np.arange(1, N_HARMONICS + 1)
    commands = np.hstack([np.cos(phase), np.sin(phase)]) @ amplitudes / SNAP.winch.command_range
    env = HeaveVectorEnv(SNAP, n, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=[FIRST_TEST_SEED] * n)
    heave, tension = np.empty((2, SCORED, n))
    for step, command in enumerate(np.clip(commands, -1.0, 1.0).astype(np.float32)):
        info = env.step(command[:, None])[-1]
        if step >= SETTLED:
            heave[step - SETTLED], tension[step - SETTLED] = info["payload_heave"], info["tension_max"]
    env.close()
    return heave.std(axis=0), np.quantile(tension, 0.999, axis=0)


@pytest.mark.slow
def test_little_is_left_to_gain_on_the_plan_at_equal_motion():
    """Tuned `mpc` beside the best periodic command that leaves no more motion."""
    trajectory = rollout(
        SNAP, design("mpc", SNAP), range(FIRST_TEST_SEED, FIRST_TEST_SEED + 4), duration=300.0
    )
    found = scores(trajectory, window(300.0, SNAP.control_dt, 100.0))
    motion, peak = (float(found[key].mean()) for key in ("payload_heave_std", "tension_p999"))

    def objective(amplitudes: np.ndarray) -> np.ndarray:
        std, tension = periodic(amplitudes.reshape(2 * N_HARMONICS, -1))
        return tension / peak + 100.0 * np.maximum(std - motion, 0.0)

    largest = np.tile([3.0] + [0.5] * (N_HARMONICS - 1), 2)
    best = differential_evolution(
        objective, np.column_stack([-largest, largest]), vectorized=True, updating="deferred", polish=False,
        popsize=8, maxiter=400, tol=1e-4, rng=0,
    )  # fmt: skip
    std, tension = (float(value[0]) for value in periodic(best.x[:, None]))
    print(
        f"tuned mpc: {motion:.3f} m, {peak / 1e3:.2f} kN; best periodic command: {std:.3f} m, "
        f"{tension / 1e3:.2f} kN, {tension / peak:.3f} of it, after {best.nit} generations"
    )
    assert std <= motion + 0.002
    assert 0.95 < tension / peak < 1.0
