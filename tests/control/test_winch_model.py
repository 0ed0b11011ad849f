"""The winch that controllers reckon with is the plant's, and it can be asked what command does what."""

from dataclasses import replace

import numpy as np
import pytest

from baselines.winch_model import winch_model
from heave_env.plant import simulate
from heave_env.scenarios import load, with_value

LIMITS = with_value(load("limits_linear"), "start", "hanging")


def with_(scenario, **values):
    for path, value in values.items():
        scenario = with_value(scenario, path.replace("__", "."), value)
    return scenario


DRIVE = {"winch__time_constant": None, "winch__natural_omega": 1.5, "winch__damping_ratio": 0.5}
NO_LIMITS = {"winch__speed_limit": None, "winch__acceleration_limit": None}
CASES = [
    {},
    {"winch__acceleration_limit": None},
    NO_LIMITS,
    {"winch__stroke_limit": 0.3},
    {"winch__command_delay": 0.15},
    {"winch__command_delay": 0.0, "n_substeps": 5},
    DRIVE,
    DRIVE | NO_LIMITS,
    DRIVE | {"winch__acceleration_limit": None, "winch__command_delay": 0.15},
    DRIVE | {"winch__speed_limit": None, "winch__stroke_limit": 0.3},
    DRIVE | NO_LIMITS | {"winch__dead_band": 0.05, "winch__command_step": 0.02},
    NO_LIMITS | {"winch__dead_band": 0.05},
    NO_LIMITS | {"winch__command_step": 0.02},
    {"winch__dead_band": 0.05, "winch__command_step": 0.02},
    {"winch__acceleration_limit": None, "winch__dead_band": 0.05, "winch__stroke_limit": 0.3},
]


def with_many(scenario, changes):
    """With values that contradict each other while only some of them are set."""
    own = {path.partition("__")[2]: value for path, value in changes.items() if path.startswith("winch__")}
    rest = {path: value for path, value in changes.items() if not path.startswith("winch__")}
    return with_(replace(scenario, winch=replace(scenario.winch, **own)), **rest)


@pytest.mark.parametrize("changes", CASES)
def test_it_follows_the_plant_to_rounding(changes):
    scenario = with_many(LIMITS, changes)
    n_steps, n_rows = 300, 8
    steps = np.random.default_rng(0).normal(size=(n_steps, n_rows))
    given = np.clip(0.15 * np.cumsum(steps, axis=0), -2.0, 2.0)
    record = simulate(scenario, seeds=range(n_rows), duration=30.0, commands=given)
    winch = winch_model(scenario)
    u, v, commands = np.zeros(n_rows), np.zeros(n_rows), np.zeros((n_rows, 1 + winch.n_pending))
    for step in range(n_steps):
        commands = np.column_stack([given[step], commands[:, :-1]])
        u, v, path = winch.path(u, v, commands, first=0, count=winch.n_substeps)
        assert u == pytest.approx(record["winch_displacement"][step + 1], abs=1e-12)
        assert v == pytest.approx(record["winch_rate"][step + 1], abs=1e-12)
        assert np.array_equal(path[:, -2], u)


@pytest.mark.parametrize("changes", [{}, {"winch__stroke_limit": 0.3}, {"winch__command_delay": 0.15}])
def test_the_compiled_lag_is_the_general_drive(changes):
    winch, general = (winch_model(with_many(LIMITS, changes)) for _ in range(2))
    general.__dict__["is_plain"] = False
    assert winch.is_plain and winch.ramps
    rng = np.random.default_rng(0)
    u, v, rate = (rng.uniform(-size, size, 500) for size in (0.35, 1.0, 1.2))
    commands = rng.uniform(-2.0, 2.0, (500, 1 + winch.n_pending))
    for ours, theirs in zip(
        winch.step(u, v, commands[:, 0]), general.step(u, v, commands[:, 0]), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-14)
    paths = (drum.path(u, v, commands, first=0, count=winch.n_substeps)[2] for drum in (winch, general))
    np.testing.assert_allclose(*paths, rtol=0.0, atol=1e-13)
    asked = (drum.command_for_rate(u, v, rate) for drum in (winch, general))
    np.testing.assert_allclose(*asked, rtol=0.0, atol=1e-11)


POWER = {"winch__power_limit": 1.6e4}
TORQUE = {"winch__torque_limit": 1.1e5, "winch__drum_radius": 1.0, "winch__drum_inertia": 3e4}


@pytest.mark.parametrize("changes", [POWER, TORQUE, DRIVE | POWER, DRIVE | TORQUE | POWER])
def test_it_feels_the_tension_as_the_plant_does(changes):
    # One solver step in a control step: the record has the tension that each of them began with.
    calm = with_(load("sea_state_5"), start="hanging", n_substeps=1)
    scenario = with_many(replace(calm, sea_state=replace(calm.sea_state, kind="calm")), changes)
    n_steps, n_rows = 200, 4
    steps = np.random.default_rng(0).normal(size=(n_steps, n_rows))
    given = np.clip(0.1 * np.cumsum(steps, axis=0), -2.0, 2.0)
    record = simulate(scenario, seeds=range(n_rows), duration=20.0, commands=given)
    winch, easy = winch_model(scenario), winch_model(calm)
    assert winch.feels_tension and not easy.feels_tension
    u, v, commands = np.zeros(n_rows), np.zeros(n_rows), np.zeros((n_rows, 1 + winch.n_pending))
    felt = 0.0
    for step in range(n_steps):
        commands = np.column_stack([given[step], commands[:, :-1]])
        tension = record["sheave_tension"][step]
        other, _, _ = winch.path(u, v, commands, first=0, count=1)
        u, v, _ = winch.path(u, v, commands, first=0, count=1, tension=tension)
        assert u == pytest.approx(record["winch_displacement"][step + 1], abs=1e-12)
        assert v == pytest.approx(record["winch_rate"][step + 1], abs=1e-12)
        felt = max(felt, float(np.abs(other - u).max()))
    # Whoever took the tension of the cable hanging still would soon be wrong.
    assert felt > 1e-4


def carried_out(winch, u, v, command):
    for _ in range(winch.n_substeps):
        u, _, v = winch.step(u, v, command)
    return u, v


def test_a_rate_within_reach_is_reached_and_one_beyond_as_nearly_as_can_be():
    winch = winch_model(LIMITS)
    rng = np.random.default_rng(1)
    n = 5000
    u, v = rng.normal(0.0, 0.3, n), rng.uniform(-0.265, 0.265, n)
    wanted = np.clip(v + rng.uniform(-0.04, 0.04, n), -0.265, 0.265)
    _, rate = carried_out(winch, u, v, winch.command_for_rate(u, v, wanted))
    # 0.25 m/s² over a tenth of a second; half a per cent of it is what three corrections leave.
    assert rate == pytest.approx(np.clip(wanted, v - 0.025, v + 0.025), abs=1.2e-4)
    # The lag alone, inverted, loses a good part of the acceleration where the drum is fast.
    naive = np.clip(u + wanted / winch.rate_constant, -4.0, 4.0)
    _, rate = carried_out(winch, u, v, naive)
    assert np.abs(rate - np.clip(wanted, v - 0.025, v + 0.025)).max() > 5e-3


@pytest.mark.parametrize("speed_limit", [0.265, None])
def test_a_displacement_within_reach_is_reached(speed_limit):
    winch = winch_model(with_(LIMITS, winch__acceleration_limit=None, winch__speed_limit=speed_limit))
    rng = np.random.default_rng(2)
    u, step = rng.normal(0.0, 0.3, 2000), rng.uniform(-0.03, 0.03, 2000)
    reached, _ = carried_out(winch, u, np.zeros(2000), winch.command_for_displacement(u, u + step))
    reachable = np.clip(step, -winch.speed_limit * 0.1, winch.speed_limit * 0.1)
    assert reached - u == pytest.approx(reachable, abs=3e-5)


@pytest.mark.parametrize(
    ("changes", "tolerance"),
    # A free drive is inverted exactly; beside a limit within the step, to what three corrections leave.
    [(DRIVE | NO_LIMITS, 1e-9), (DRIVE | {"winch__speed_limit": None}, 1e-4), (DRIVE, 1e-4)],
)
def test_a_drive_reaches_the_rate_that_it_is_asked_for(changes, tolerance):
    winch = winch_model(with_many(LIMITS, changes))
    rng = np.random.default_rng(1)
    n = 2000
    u, v = rng.normal(0.0, 0.3, n), rng.uniform(-0.24, 0.24, n)
    wanted = v + rng.uniform(-0.024, 0.024, n)
    _, rate = carried_out(winch, u, v, winch.command_for_rate(u, v, wanted))
    assert rate == pytest.approx(wanted, abs=tolerance)


@pytest.mark.parametrize("base", [NO_LIMITS, DRIVE | NO_LIMITS, {}])
def test_a_dead_band_is_inverted_and_rounding_costs_no_more_than_half_a_step(base):
    rng = np.random.default_rng(4)
    n = 1000
    u, v = rng.normal(0.0, 0.3, n), rng.uniform(-0.2, 0.2, n) if base != NO_LIMITS else np.zeros(n)
    meant = u + rng.uniform(-0.3, 0.3, n)
    for uneven in ({"winch__dead_band": 0.1}, {"winch__command_step": 0.05}):
        winch = winch_model(with_many(LIMITS, base | uneven))
        wanted, _ = carried_out(winch.even, u, v, meant)
        missed = {}
        for kind, given in (("meant", meant), ("shaped", winch.shaped(u, v, meant))):
            end, _ = carried_out(winch, u, v, given)
            missed[kind] = np.abs(end - wanted)
            assert np.abs(given).max() <= 4.0
        assert np.sqrt(np.mean(missed["shaped"] ** 2)) <= np.sqrt(np.mean(missed["meant"] ** 2)) * (
            1.0 + 1e-9
        )
        print(base, uneven, {kind: float(np.sqrt(np.mean(miss**2))) for kind, miss in missed.items()})
        if "winch__dead_band" in uneven and base == NO_LIMITS:
            # What cannot be had: a drum that moves at all goes on for a whole solver step, by some
            # 0.1 m (1 - exp(-K dt)); half of it is missed at most.
            assert missed["shaped"].max() < 0.6 * 0.1 * (1.0 - winch.decay) < 0.4 * missed["meant"].max()
        if "winch__command_step" in uneven:
            quanta = winch.shaped(u, v, meant) / 0.05
            assert quanta == pytest.approx(np.round(quanta), abs=1e-9)


def test_a_winch_without_dead_band_and_rounding_is_sent_what_is_meant():
    winch = winch_model(LIMITS)
    meant = np.linspace(-1.0, 1.0, 7)
    assert winch.shaped(np.zeros(7), np.zeros(7), meant) is meant


def test_no_command_leaves_the_range():
    winch = winch_model(LIMITS)
    far = np.array([3.9, -3.9])
    fast = np.array([0.26, -0.26])
    assert np.abs(winch.command_for_rate(far, fast, fast)).max() <= 4.0
    assert np.abs(winch.command_for_displacement(far, 2.0 * far)).max() <= 4.0
