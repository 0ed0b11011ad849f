"""The stochastic-optimal controller, its filter and its bound: closed forms and published figures."""

import math
from dataclasses import replace

import numpy as np
import pytest

from baselines import design
from baselines.bound import optimal_cost
from baselines.kalman import doubled_riccati, filter_covariance, kalman_filter
from baselines.lqg import continuous_performance, lqg
from baselines.model import continuous_model, linear_model
from baselines.optimisation import index_curves, weight_for, winch_curve
from heave_env.scenarios import load, with_value
from heave_env.sensors import Sensor

LINEAR = load("thesis_linear")
PAYLOAD_MOTION = np.eye(2, 11)


def with_(scenario, **values):
    for path, value in values.items():
        scenario = with_value(scenario, path.replace("__", "."), value)
    return scenario


@pytest.mark.parametrize(
    ("q", "std", "index"),
    [(100.0, 1.627e-3, 9.74), (554.0, 2.96e-4, 23.0), (1000.0, 1.640e-4, 31.0)],
)
def test_full_state_design_leaves_the_published_motion(q, std, index):
    # q = 554 is the thesis's figure 6.24; the others follow from the same equations.
    result = continuous_performance(continuous_model(LINEAR), q, 1.0)
    assert result.payload_heave_std == pytest.approx(std, rel=1e-3)
    assert result.energy_index == pytest.approx(index, rel=2e-3)
    # The winch is nearly inverted: the command hardly depends on the weight.
    assert result.command_std == pytest.approx(0.19, abs=0.005)


@pytest.mark.parametrize(
    ("q", "std", "index"),
    [(100.0, 1.6276e-3, 8.354), (554.0, 2.9582e-4, 18.272), (1000.0, 1.6402e-4, 23.836)],
)
def test_the_sampled_design_at_a_tenth_of_a_second_has_its_own_figures(q, std, index):
    # Nearly the same motion from another gain: these digits are ours, shown beside the thesis's.
    full = with_(LINEAR, information_set="full_state", task__position_weight=q)
    controller = lqg(full)
    assert controller.predicted_payload_std == pytest.approx(std, rel=1e-3)
    assert controller.energy_index == pytest.approx(index, rel=1e-3)
    assert controller.performance.command_std == pytest.approx(0.194, abs=0.002)


@pytest.mark.parametrize(("q", "std"), [(100.0, 3.99e-3), (1000.0, 2.30e-3)])
def test_with_noisy_payload_sensors_the_filter_sets_the_motion(q, std):
    result = continuous_performance(
        continuous_model(LINEAR), q, 1.0, outputs=PAYLOAD_MOTION, densities=np.full(2, 1e-6)
    )
    assert result.payload_heave_std == pytest.approx(std, rel=2e-3)
    sampled = lqg(with_(LINEAR, task__position_weight=q))
    # Sample and hold costs one or two per cent more.
    assert 1.0 < sampled.predicted_payload_std / result.payload_heave_std < 1.02


def test_the_scalar_filter_is_the_root_of_its_quadratic():
    a, w, v = 0.98, 0.2, 1.3
    P = filter_covariance(np.array([[a]]), np.eye(1), np.array([[w]]), np.array([[v]])).item()
    # P = a² P v / (P + v) + w  <=>  P² + (v - a² v - w) P - w v = 0
    p = v - a**2 * v - w
    root = (-p + math.sqrt(p**2 + 4.0 * w * v)) / 2.0
    assert pytest.approx(root, rel=1e-12) == P


@pytest.mark.parametrize("delay", [0.0, 0.15, 0.4])
def test_doubling_and_scipy_agree_on_the_filter_of_the_whole_model(delay):
    model = linear_model(with_(LINEAR, winch__command_delay=delay)).select(
        ("payload_heave", "payload_heave_rate")
    )
    scipy = filter_covariance(model.A, model.C, model.W, model.V)
    doubling = doubled_riccati(model.A, model.C, model.W, model.V)
    assert doubling == pytest.approx(scipy, abs=1e-9)


def test_the_filter_solves_its_riccati_equation_and_knows_the_commands():
    estimator = kalman_filter(with_(LINEAR, winch__command_delay=0.2))
    A, C, W, V = estimator.model.A, estimator.model.C, estimator.model.W, estimator.model.V
    P = estimator.prior_covariance
    assert A @ estimator.posterior_covariance @ A.T + W == pytest.approx(P, abs=1e-12)
    assert np.min(np.linalg.eigvalsh(P)) > -1e-12
    for name in ("winch_displacement", "pending_command_1", "pending_command_2"):
        assert abs(P[estimator.model.index(name)]).max() < 1e-12
    # The posterior of what is measured is smaller than its noise.
    assert np.all(np.diag(C @ estimator.posterior_covariance @ C.T) < np.diag(V))


def test_python_control_s_predictor_gain_is_ours_advanced_a_step():
    control = pytest.importorskip("control")
    estimator = kalman_filter(LINEAR)
    model = estimator.model
    n = model.n_states
    # control.dlqe returns A M, not M (python-control issue 1173).
    predictor, _, _ = control.dlqe(model.A, np.eye(n), model.C, model.W, model.V, method="scipy")
    assert model.A @ estimator.gain == pytest.approx(np.asarray(predictor), abs=1e-7)


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.2, 0.35])
@pytest.mark.parametrize("information_set", ["full_state", "sensors", "sensors_history"])
def test_trace_formula_and_closed_loop_covariance_give_the_same_cost(information_set, delay):
    # Two independent ways to the same number: Riccati traces, and the Lyapunov equation of plant and filter.
    scenario = with_(LINEAR, information_set=information_set, winch__command_delay=delay)
    assert lqg(scenario).predicted_cost == pytest.approx(optimal_cost(scenario), rel=1e-7)


def test_history_adds_nothing_that_the_filter_does_not_know():
    history = with_(LINEAR, information_set="sensors_history")
    assert optimal_cost(history) == pytest.approx(optimal_cost(LINEAR), rel=1e-12)


def test_delay_noise_and_blindness_each_cost_something():
    best = optimal_cost(with_(LINEAR, information_set="full_state"))
    assert best == pytest.approx(0.037677, rel=1e-4)
    assert optimal_cost(LINEAR) == pytest.approx(0.044242, rel=1e-4)
    assert best < optimal_cost(LINEAR) < optimal_cost(with_(LINEAR, winch__command_delay=0.2))
    noisier = with_(LINEAR, sensors__payload_heave__noise_density=1e-4)
    assert optimal_cost(noisier) > optimal_cost(LINEAR)
    late = with_(LINEAR, sensors__payload_heave__delay=0.5, sensors__payload_heave_rate__delay=0.5)
    assert optimal_cost(late) > optimal_cost(LINEAR)


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.2, 0.3])
def test_no_regulator_is_predicted_below_the_bound(delay):
    scenario = with_(LINEAR, winch__command_delay=delay)
    for name in ("lqr", "delay_lqr"):
        assert design(name, scenario).predicted_cost > optimal_cost(scenario)


def test_no_linear_controller_near_the_optimum_is_better():
    # Perturb the filter and the feedback: the predicted cost may only rise.
    from baselines.linear_controller import closed_loop

    best = lqg(LINEAR)
    model = linear_model(LINEAR).select(best.measures)
    rng = np.random.default_rng(3)
    for _ in range(20):
        G = best.G * (1.0 + 0.01 * rng.normal(size=best.G.shape))
        D = best.D * (1.0 + 0.01 * rng.normal(size=best.D.shape))
        worse = closed_loop(model, LINEAR, F=best.F, G=G, H=best.H, L=best.L, D=D)
        assert worse.cost >= best.predicted_cost * (1.0 - 1e-9)


@pytest.mark.parametrize(
    "change",
    [
        {"winch.speed_limit": 0.3},
        {"sensors.payload_heave.scale_error": 0.05},
        {"winch.command_range": 0.5},
        {"sea_state.kind": "random_phase"},
        {"sea_state.kind": "calm"},
    ],
)
def test_no_optimum_is_claimed_where_none_is_proven(change):
    scenario = LINEAR
    for path, value in change.items():
        scenario = with_value(scenario, path, value)
    assert optimal_cost(scenario) is None


def test_no_optimum_is_claimed_for_a_cable():
    assert optimal_cost(load("sea_state_5")) is None
    assert lqg(load("sea_state_5"), command_weight=100.0).predicted_cost is None


@pytest.mark.parametrize("delay", [0.0, 0.15, 0.2])
@pytest.mark.parametrize("information_set", ["full_state", "sensors"])
def test_a_second_order_drive_has_its_optimum_too(information_set, delay):
    drive = replace(LINEAR.winch, time_constant=None, natural_omega=2.0, command_delay=delay)
    scenario = replace(LINEAR, winch=drive, information_set=information_set)
    # Riccati traces, and the Lyapunov equation of plant and filter.
    assert lqg(scenario).predicted_cost == pytest.approx(optimal_cost(scenario), rel=1e-6)
    for name in ("lqr", "delay_lqr"):
        assert design(name, scenario).predicted_cost > optimal_cost(scenario)


def test_lqg_refuses_a_calm_sea_and_useless_sensors_with_a_sentence():
    with pytest.raises(ValueError, match="calm sea"):
        lqg(with_(LINEAR, sea_state__kind="calm"))
    with pytest.raises(ValueError, match="measures nothing that a linear filter can use"):
        lqg(replace(LINEAR, sensors=(Sensor(channel="winch_rate"),)))


def test_there_is_a_winch_quick_enough_and_a_slow_one_costs_steeply():
    # Figure 6.25: beyond a critical K nothing is saved, below it the energy rises significantly.
    rate_constants = np.array([0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 50.0])
    curve = winch_curve(LINEAR, 2.96e-4, rate_constants)
    at = dict(zip(rate_constants, curve.energy_index, strict=True))
    assert at[1.0] == pytest.approx(23.0, rel=5e-3)
    assert at[5.0] == pytest.approx(at[50.0], rel=0.01)
    assert at[0.1] > 4.0 * at[1.0]
    assert np.all(np.diff(curve.command_std) < 0.0)


def test_the_weight_for_a_prescribed_motion_gives_that_motion():
    q = weight_for(LINEAR, 1e-3)
    result = continuous_performance(continuous_model(LINEAR), q, 1.0)
    assert result.payload_heave_std == pytest.approx(1e-3, rel=1e-6)
    for impossible in (0.3, 0.0, -1.0):
        with pytest.raises(ValueError, match="must lie between 0 and the uncontrolled"):
            weight_for(LINEAR, impossible)


def test_with_a_delay_the_same_effect_takes_more_energy():
    # Figures 6.18 and 6.19: at equal displacement (velocity) index the delayed loop needs the larger gain.
    weights = np.logspace(1.0, 5.0, 9)
    plain, delayed = index_curves(load("thesis_regulator"), weights, delay=0.2)
    for kind in ("displacement", "velocity"):
        without, with_delay = getattr(plain, kind), getattr(delayed, kind)
        assert np.all(np.diff(without) < 0.0)
        needed = np.exp(np.interp(np.log(with_delay), np.log(without[::-1]), np.log(plain.energy[::-1])))
        inside = (with_delay > without.min()) & (with_delay < without.max())
        assert inside.sum() >= 7
        assert np.all(delayed.energy[inside] > needed[inside])
