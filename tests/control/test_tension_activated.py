"""The constant-tension winch: its rule, its set-point, its dead band, and what it can and cannot do."""

from dataclasses import replace

import numpy as np
import pytest

from baselines import design
from baselines.tension_activated import (
    CENTRING_TIME,
    SENSITIVITY,
    default_band,
    hanging_tension,
    loop_over_gain,
    rule_gain,
    tension_activated,
)
from heave_env.env import HeaveVectorEnv
from heave_env.plant import simulate
from heave_env.scenarios import load, with_value
from heave_env.sensors import Sensor

DEEP, SNAP = load("deep_resonance"), load("snap")
LOAD_CELL = Sensor(channel="sheave_tension", noise_std=500.0)
LOWERING = replace(load("lowering"), sensors=(*load("lowering").sensors, LOAD_CELL))


def on_a_spring(scenario, **winch):
    """The scenario on a massless cable that a payload too heavy to move hangs on: a spring alone."""
    cable = replace(
        scenario.cable,
        mass_per_length=0.0,
        submerged_weight=0.0,
        tangential_drag_coefficient=0.0,
        axial_damping=0.0,
    )
    return replace(
        scenario,
        n_elements=1,
        cable=cable,
        payload=replace(scenario.payload, mass=1e12, drag_area=0.0),
        winch=replace(scenario.winch, **winch),
    )


def stiffness(scenario):
    return scenario.cable.axial_stiffness / scenario.length


def least_distance(scenario, gain):
    """Least |1 + G| of the sampled loop on a spring, winch as quick as its command, by its own equations."""
    dt, delay = scenario.control_dt, round(scenario.winch.command_delay / scenario.control_dt)
    z = np.exp(1j * np.linspace(0.001, np.pi, 20_000))
    kept = np.exp(-dt / CENTRING_TIME)
    return np.min(np.abs(1.0 + gain * stiffness(scenario) * dt / (z - kept) * z ** (-float(delay))))


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.2, 0.5])
def test_on_a_spring_the_rule_keeps_the_margin_of_the_sampled_loop(delay):
    scenario = on_a_spring(DEEP, command_delay=delay)
    gain = rule_gain(scenario, scenario.length)
    if delay == 0.0:
        assert gain * stiffness(scenario) * scenario.control_dt == pytest.approx(1.0, rel=1e-9)
    # Aliases beyond the third are left out.
    assert least_distance(scenario, gain) == pytest.approx(1.0 / SENSITIVITY, rel=0.06)


def test_the_gain_falls_with_delay_and_stiffness():
    late = [with_value(DEEP, "winch.command_delay", delay) for delay in (0.0, 0.2, 0.5)]
    gains = [rule_gain(scenario, DEEP.length) for scenario in late]
    assert gains == sorted(gains, reverse=True)
    assert rule_gain(LOWERING, 50.0) < rule_gain(LOWERING, 750.0)
    older = replace(
        DEEP,
        sensors=tuple(
            replace(item, delay=0.3) if item.channel == "sheave_tension" else item for item in DEEP.sensors
        ),
    )
    assert rule_gain(older, DEEP.length) == pytest.approx(gains[2])


def test_the_rule_touches_its_margin_and_nowhere_comes_nearer():
    omega = np.geomspace(1e-2, np.pi / DEEP.control_dt, 3000)
    G = rule_gain(DEEP, DEEP.length) * loop_over_gain(DEEP, DEEP.length, omega)
    assert np.min(np.abs(1.0 + G)) == pytest.approx(1.0 / SENSITIVITY, rel=1e-6)


def test_the_set_point_is_the_tension_in_still_water():
    still = replace(LOWERING, sea_state=replace(LOWERING.sea_state, kind="calm"), start="hanging")
    channels = simulate(still, seeds=[0])
    controller = tension_activated(LOWERING)
    # Before the pay-out, and while it runs evenly.
    for part in (slice(0, 150), slice(500, 3400)):
        plant = channels["sheave_tension"][part, 0]
        assert controller.set_point[part] == pytest.approx(plant, rel=0.01)
    assert hanging_tension(LOWERING, np.array([100.0]), np.array([-2.0])) > hanging_tension(
        LOWERING, np.array([100.0]), np.array([0.0])
    )


def test_it_pays_out_above_the_band_hauls_in_below_and_rests_within():
    controller = tension_activated(DEEP)
    middle, band = controller.set_point[0], controller.band
    assert band == default_band(DEEP) == pytest.approx(max(1500.0, 0.01 * DEEP.static_tension))
    y = middle + np.array([[2.0 * band], [0.99 * band], [0.0], [-0.99 * band], [-2.0 * band]])
    command, memory = controller.respond(y, np.zeros((5, 3)))
    assert command[0] < 0.0 < command[4]
    assert np.all(command[1:4] == 0.0)
    # The error beyond the band times the gain is the speed.
    assert memory[0, 0] == pytest.approx(-controller.loop_gain[0] * band * DEEP.control_dt)


def test_the_winch_follows_the_wanted_path_from_instant_to_instant():
    controller = tension_activated(DEEP)
    wanted, u, memory = 0.0, 0.0, np.zeros((1, 3))
    for tension in (1.2, 0.9, 0.7, 1.1):
        command, memory = controller.respond(np.array([[tension * DEEP.static_tension]]), memory)
        u = command.item() + (u - command.item()) * np.exp(-DEEP.winch.rate_constant * DEEP.control_dt)
        wanted = memory[0, 0]
        assert u == pytest.approx(wanted)


def test_left_alone_it_goes_back_to_the_middle_and_does_not_wind_up():
    controller = tension_activated(DEEP, integral_time=2.0)
    rest = np.full((1, 1), controller.set_point[0])
    _, memory = controller.respond(rest, np.array([[1.0, 0.0, 0.0]]))
    assert memory[0, 0] == pytest.approx(np.exp(-DEEP.control_dt / CENTRING_TIME))
    memory, kept = np.zeros((1, 3)), []
    for _ in range(600):
        command, memory = controller.respond(np.zeros((1, 1)), memory)
        kept.append(memory[0, 1])
    # Slack for a minute: at the end of the winch's reach the integral stands still.
    assert abs(command.item()) <= DEEP.winch.command_range
    assert kept[-1] == kept[-300]


def test_a_slack_cable_asks_for_no_more_than_the_winch_can():
    for scenario, fastest in ((SNAP, SNAP.winch.speed_limit), (LOWERING, 2.0)):
        controller = tension_activated(scenario)
        assert np.all(controller.loop_gain * controller.set_point <= fastest * (1.0 + 1e-12))
        # Which binds, somewhere along the plan.
        assert np.max(controller.loop_gain * controller.set_point) == pytest.approx(fastest)


def held(scenario, controller, seconds=200.0, n=8):
    """Payload's and top tension's standard deviation in test seas after 50 s, and without control."""
    found = []
    for acting in (None, controller):
        env = HeaveVectorEnv(replace(scenario, duration=seconds), num_envs=n)
        observation, _ = env.reset(seed=[20_000_000 + i for i in range(n)])
        memory, record = None, []
        for _ in range(round(seconds / scenario.control_dt)):
            action = np.zeros((n, 1), np.float32)
            if acting is not None:
                action, memory = acting.predict(observation, memory)
            observation, _, _, _, info = env.step(action)
            record.append([info["payload_heave"], info["sheave_tension"]])
        env.close()
        found.append(np.std(np.array(record)[500:], axis=0).mean(axis=1))
    return found


def test_near_resonance_holding_the_tension_holds_the_payload():
    (locked, tension), (heave, less) = held(DEEP, tension_activated(DEEP))
    print(f"deep_resonance: payload {locked:.3f} to {heave:.3f} m, tension {tension:.0f} to {less:.0f} N")
    assert heave < 0.8 * locked
    assert less < 0.8 * tension


def test_the_loop_bears_nearly_twice_the_rules_gain_and_not_four_times():
    (_, locked), (_, less) = held(DEEP, tension_activated(DEEP, bandwidth=1.8), n=2)
    assert less < locked
    # Beyond the margin the cable's second mode swings up until it goes slack: the tension shows it first.
    (_, locked), (_, more) = held(DEEP, tension_activated(DEEP, bandwidth=4.0), n=2)
    print(f"tension {locked:.0f} N, at 1.8 times the gain {less:.0f} N, at 4 times {more:.0f} N")
    assert more > 2.0 * locked


def test_who_has_no_cable_or_no_load_cell_says_so_in_a_sentence():
    with pytest.raises(ValueError, match="has a linear payload and no cable; add a cable, or choose pid"):
        design("tension_activated", load("thesis_linear"))
    with pytest.raises(
        ValueError, match="needs sheave_tension measured, which scenario 'sea_state_5' does not"
    ):
        design("tension_activated", load("sea_state_5"))
    for name, value in (("bandwidth", 0.0), ("integral_time", -1.0), ("band", -1.0)):
        with pytest.raises(ValueError, match=f"{name} must be a "):
            tension_activated(DEEP, **{name: value})
