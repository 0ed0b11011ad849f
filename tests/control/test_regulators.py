"""The thesis's regulators: closed forms, published gains, and what a delay does."""

import math
from dataclasses import replace

import control
import numpy as np
import pytest

from baselines.delay_lqr import delay_lqr, taylor_matrices
from baselines.lqr import continuous_gain, lqr, sampled_gain
from baselines.model import held_command, regulator_matrices
from heave_env.parameters import LinearPayload
from heave_env.scenarios import load, with_value

RECOVERED = LinearPayload(inertia=2.28, damping=2.43)
"""The a and b that the printed gains belong to."""


def test_the_scalar_gain_is_the_root_of_its_quadratic():
    a, b, q, r = 0.97, 0.3, 4.0, 0.5
    gain, S = sampled_gain(np.array([[a]]), np.array([[b]]), q, r)
    # S = q + a² S r / (r + b² S)  <=>  b² S² + (r - a² r - b² q) S - q r = 0
    p = r - a**2 * r - b**2 * q
    root = (-p + math.sqrt(p**2 + 4.0 * b**2 * q * r)) / (2.0 * b**2)
    assert S.item() == pytest.approx(root, rel=1e-12)
    assert gain.item() == pytest.approx(a * b * root / (r + b**2 * root), rel=1e-12)


def test_the_continuous_scalar_gain_is_the_closed_form():
    a, b, q, r = -0.4, 1.5, 3.0, 0.7
    gain = continuous_gain(np.array([[a]]), np.array([[b]]), q, r)
    assert gain.item() == pytest.approx((a + math.sqrt(a**2 + b**2 * q / r)) / b, rel=1e-12)


def test_published_regulator_gains_within_their_print():
    # G = [93.944, 41.41, 5.166], caption of figure 6.15; the recovered a and b give it within 1.2 %.
    A, B, _ = regulator_matrices(RECOVERED, 1.0)
    gain = continuous_gain(A, B, 1e4, 1.0)[0]
    assert gain == pytest.approx([93.944, 41.41, 5.166], rel=0.015)


def test_published_delay_gains_within_their_print():
    # Caption of figure 6.17: five states of the Taylor model (6.14), 0.2 s.
    A, B = taylor_matrices(RECOVERED, 1.0, 0.2)
    gain = continuous_gain(A, B, 1e5, 1.0)[0]
    assert gain == pytest.approx([296.97, 132.73, 15.95, 2.306, 0.164], rel=0.015)


def test_python_control_agrees_on_both_gains():
    A, B, _ = regulator_matrices(RECOVERED, 1.0)
    Q, R = np.diag([1e4, 0.0, 0.0]), np.array([[1.0]])
    assert continuous_gain(A, B, 1e4, 1.0) == pytest.approx(
        np.asarray(control.lqr(A, B, Q, R, method="scipy")[0]), rel=1e-8
    )
    F, G = held_command(A, B, 0.1)
    assert sampled_gain(F, G, 1e4, 1.0)[0] == pytest.approx(
        np.asarray(control.dlqr(F, G, Q, R, method="scipy")[0]), rel=1e-8
    )


def test_the_sampled_gain_tends_to_the_continuous_one():
    scenario = load("thesis_regulator")
    continuous = lqr(scenario, design="continuous").gain
    errors = []
    for dt in (0.1, 0.05, 0.025):
        sampled = lqr(replace(scenario, control_dt=dt)).gain
        errors.append(np.max(np.abs(sampled / continuous - 1.0)))
    # First order in the step, since a held command is late by half a step.
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.15)


def test_energy_index_of_the_regulator_is_the_norm_of_its_gain():
    # Continuous design with the printed a, b and q = 1e4; the thesis prints the gains of another a and b.
    controller = lqr(load("thesis_regulator"), design="continuous")
    assert controller.energy_index == pytest.approx(np.linalg.norm(controller.gain))
    assert controller.energy_index == pytest.approx(126.05, abs=0.1)
    assert lqr(load("thesis_regulator")).energy_index == pytest.approx(106.32, abs=0.1)


def test_a_modelled_winch_serves_as_well_as_a_measured_one():
    # Without delay and noise in the winch, displacement follows from the controller's own commands.
    scenario = load("thesis_regulator")
    blind = replace(scenario, sensors=scenario.sensors[:2])
    assert lqr(blind).n_memory == 1
    assert lqr(blind).predicted_cost == pytest.approx(lqr(scenario).predicted_cost, rel=1e-9)
    delayed = load("thesis_regulator_delay")
    blind = replace(delayed, sensors=delayed.sensors[:2])
    assert delay_lqr(blind).predicted_cost == pytest.approx(delay_lqr(delayed).predicted_cost, rel=1e-9)


def test_ignoring_the_delay_destabilises_the_thesis_regulator():
    scenario = load("thesis_regulator_delay")
    plain = lqr(scenario)
    assert plain.performance.spectral_radius > 1.0
    assert math.isinf(plain.predicted_cost)
    assert delay_lqr(scenario).performance.spectral_radius < 1.0


def test_taylor_and_exact_delay_meet_as_the_delay_vanishes():
    # The control step shrinks with the delay (eight of them in it), so that the hold vanishes too.
    gaps = []
    for delay in (0.32, 0.16, 0.08, 0.04):
        scenario = replace(load("thesis_regulator"), control_dt=delay / 8.0, duration=100.0 * delay)
        variant = with_value(scenario, "winch.command_delay", delay)
        exact = delay_lqr(variant).performance.payload_heave_std
        taylor = delay_lqr(variant, design="taylor").performance.payload_heave_std
        gaps.append(abs(taylor / exact - 1.0))
    print(gaps)
    assert gaps[0] > gaps[1] > gaps[2] > gaps[3]


def test_without_delay_the_delay_regulator_is_the_plain_one():
    scenario = load("thesis_regulator")
    assert delay_lqr(scenario).name == "delay_lqr"
    assert np.array_equal(delay_lqr(scenario).gain, lqr(scenario).gain)


@pytest.mark.parametrize("design", [lqr, delay_lqr])
def test_a_regulator_without_payload_sensors_says_which_one_it_misses(design):
    scenario = load("thesis_linear")
    blind = replace(scenario, sensors=scenario.sensors[:1])
    with pytest.raises(ValueError, match="payload_heave_rate measured.*add that sensor"):
        design(blind)
    with pytest.raises(ValueError, match="design of .* must be one of"):
        design(scenario, design="best")
