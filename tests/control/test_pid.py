"""The PID puts its poles where its rule says, keeps its margin, and does not wind up."""

import numpy as np
import pytest

from baselines import design
from baselines.linear_controller import closed_loop
from baselines.model import linear_model
from baselines.pid import DAMPING_RATIO, INTEGRAL, loop_frequency, pid, pole_placement
from baselines.tuning import training_cost, tuning_scenario
from heave_env.scenarios import load, with_value

THESIS = load("thesis_linear")


def with_(scenario, **values):
    for path, value in values.items():
        scenario = with_value(scenario, path.replace("__", "."), value)
    return scenario


def test_the_gains_place_the_poles_of_the_model():
    kp, ki, kd = pole_placement(THESIS)
    a, b = THESIS.linear_payload.inertia, THESIS.linear_payload.damping
    omega = loop_frequency(THESIS)
    wanted = omega * np.array([-INTEGRAL, *np.roots([1.0, 2.0 * DAMPING_RATIO, 1.0])])
    found = np.roots([a, b + kd, 1.0 + kp, ki])
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(wanted), rel=1e-9)
    # No delay: half a control step and a tenth of the winch's lag are left, 0.15 s for 0.3 rad.
    assert omega == pytest.approx(2.0)


@pytest.mark.parametrize("delay", [0.0, 0.2, 0.5, 1.9])
def test_the_loop_bears_twice_its_gains_at_any_delay(delay):
    scenario = with_(THESIS, winch__command_delay=delay)
    controller = pid(scenario)
    assert controller.performance.spectral_radius < 1.0
    model = linear_model(scenario).select(controller.measures)
    # Twice kp, ki and kd; the lead stays, and what the integral hears of the clipping is zero without it.
    L, D = controller.L * [2.0, 1.0], 2.0 * controller.D
    F, G, H = controller.F.copy(), controller.G.copy(), controller.H.copy()
    F[0], G[0], H[0] = [1.0, 0.0], [scenario.control_dt, 0.0], 0.0
    doubled = closed_loop(model, scenario, F=F, G=G, H=H, L=L, D=D)
    assert doubled.spectral_radius < 1.0
    # It still does some good, the less the longer the delay.
    assert controller.performance.payload_heave_std < 0.2551


def test_a_longer_delay_leaves_more():
    left = [pid(with_(THESIS, winch__command_delay=d)).performance.payload_heave_std for d in (0, 0.2, 0.5)]
    assert left == sorted(left)


def test_a_steady_push_is_taken_back_and_a_clipped_command_does_not_wind_up():
    controller = pid(THESIS)
    stuck, memory = np.array([[0.01, 0.0]]), np.zeros((1, 2))
    asked = []
    for _ in range(600):
        command, memory = controller.respond(stuck, memory)
        asked.append(command.item())
    # The payload does not give way: the integral asks for more and more, up to the range ...
    assert asked[-1] < asked[300] < asked[30] < 0.0
    far, memory, kept = np.array([[1.0, 0.0]]), np.zeros((1, 2)), []
    for _ in range(600):
        command, memory = controller.respond(far, memory)
        kept.append(memory)
    assert command == -THESIS.winch.command_range
    # ... where a minute of it leaves no more behind than half a minute.
    assert kept[-1] == pytest.approx(kept[300], abs=0.02)


def test_it_drives_cables_with_a_bandwidth_that_they_bear():
    controller = design("pid", load("deep_resonance"), bandwidth=0.5)
    assert controller.performance.spectral_radius < 1.0


@pytest.mark.slow
def test_tuning_gives_a_heavy_cable_more_bandwidth_than_the_rule_and_not_too_much():
    scenario = load("sea_state_5")
    operation = tuning_scenario(scenario)
    by_rule, twice, more = (training_cost(operation, pid(scenario, bandwidth=b)) for b in (1.0, 2.0, 2.8))
    tuned = training_cost(operation, design("pid", scenario))
    print(f"J by the rule {by_rule:.3g}, twice the band {twice:.3g}, 2.8 times {more:.3g}; tuned {tuned:.3g}")
    # The cable's second mode at 5.19 rad/s, which the rule's model has not, sets the end.
    assert tuned == twice < 0.6 * by_rule < more
