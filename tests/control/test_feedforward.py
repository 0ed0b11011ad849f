"""Feed-forward of the boom tip: what its delay leaves, what a forecast saves, and what none can."""

from dataclasses import replace

import numpy as np
import pytest

from baselines import design
from baselines.bound import causal_bound, causal_horizon
from baselines.model import sea_filter
from baselines.peaks import N_MODES, feedforward_peaks
from experiments.rollout import FIRST_TEST_SEED, rollout
from heave_env.parameters import SeaState
from heave_env.plant import simulate
from heave_env.scenarios import load, with_value
from heave_env.sensors import Sensor

THESIS = load("thesis_linear")
BOOM_TIP = (Sensor(channel="boom_tip_heave"), Sensor(channel="boom_tip_heave_rate"))
EXACT = replace(THESIS, sensors=(*THESIS.sensors, *BOOM_TIP), duration=250.0)
SETTLED = 1000


def with_(scenario, **values):
    for path, value in values.items():
        scenario = with_value(scenario, path.replace("__", "."), value)
    return scenario


def left(scenario, kind, n_seas=32, **options):
    """Root mean square of sheave, payload and boom tip at the control instants [m], (3, n_seas)."""
    controller = design(kind, scenario, **options)
    found = rollout(scenario, controller, range(FIRST_TEST_SEED, FIRST_TEST_SEED + n_seas)).states
    boom_tip = found["boom_tip_heave"][SETTLED:]
    sheave = boom_tip + found["winch_displacement"][SETTLED:]
    return np.sqrt([(x**2).mean(axis=0) for x in (sheave, found["payload_heave"][SETTLED:], boom_tip)])


def pooled(values):
    """Root mean square over the seas and its standard error."""
    square = values**2
    mean = square.mean()
    return np.sqrt(mean), square.std(ddof=1) / np.sqrt(len(square)) / (2.0 * np.sqrt(mean))


@pytest.mark.parametrize("vessel", [None, THESIS.vessel])
def test_without_a_forecast_the_delay_leaves_its_share_of_the_motion(vessel):
    # Hs 2.5 m, Tp 8 s, 0.5 s of delay and half a control step. To first order in the time that is lost.
    sea = SeaState(significant_wave_height=2.5, peak_omega=2.0 * np.pi / 8.0)
    scenario = with_(
        replace(EXACT, sea_state=sea, vessel=vessel), winch__command_delay=0.5, winch__command_range=8.0
    )
    waves = sea_filter(scenario)
    covariance = waves.C @ waves.covariance @ waves.C.T
    theory = np.sqrt(covariance[1, 1] / covariance[0, 0]) * (0.5 + 0.05)
    sheave, _, boom_tip = left(scenario, "feedforward")
    share = pooled(sheave)[0] / pooled(boom_tip)[0]
    print(f"plain feed-forward leaves {share:.3f} of the motion, theory {theory:.3f}")
    assert share == pytest.approx(theory, rel=0.05)


@pytest.mark.parametrize(("delay", "share"), [(0.9, 9.29e-4), (2.9, 0.107)])
def test_the_bound_of_the_thesis_s_sea_is_the_published_one(delay, share):
    bound = causal_bound(with_(THESIS, winch__command_delay=delay))
    assert bound.horizon == pytest.approx(delay + 0.1)
    assert bound.sheave_heave_std / 0.1722 == pytest.approx(share, rel=2e-3)
    # What reaches the payload has been smoothed once more.
    assert bound.payload_heave_std < bound.sheave_heave_std


def test_the_bound_is_the_integral_of_the_squared_response():
    waves = sea_filter(THESIS)
    from scipy.linalg import expm

    t = np.linspace(0.0, 2.0, 2001)
    step = expm(waves.A * t[1])
    state, response = waves.B[:, 0], []
    for _ in t:
        response.append(waves.C[0] @ state)
        state = step @ state
    integral = np.pi * np.trapezoid(np.square(response), t)
    bound = causal_bound(with_(THESIS, winch__command_delay=1.9))
    assert bound.sheave_heave_std**2 == pytest.approx(integral, rel=1e-4)


def test_a_command_is_felt_at_the_first_instant_after_its_delay():
    for delay, horizon in ((0.0, 0.1), (0.05, 0.1), (0.1, 0.2), (0.15, 0.2), (0.5, 0.6)):
        assert causal_horizon(with_(THESIS, winch__command_delay=delay)) == horizon


@pytest.mark.parametrize("kind", ["random_phase", "regular", "calm"])
def test_no_bound_is_claimed_where_the_sea_can_be_foreseen(kind):
    assert causal_bound(with_(THESIS, sea_state__kind=kind)) is None


@pytest.mark.parametrize("delay", [0.5, 0.9, 1.9])
def test_the_forecast_of_who_knows_the_filter_leaves_the_bound_and_no_less(delay):
    # Noise-free, winch without limits, command free of charge: within 10 % at the control instants.
    scenario = with_(EXACT, information_set="full_state", winch__command_delay=delay)
    bound = causal_bound(scenario).sheave_heave_std
    std, error = pooled(left(scenario, "feedforward_prediction")[0])
    sampled = pooled(left(with_(EXACT, winch__command_delay=delay), "feedforward_prediction")[0])[0]
    print(
        f"delay {delay} s: {std:.4g} +- {error:.1g} m, bound {bound:.4g} m; from heave and rate alone "
        f"{sampled / bound:.2f} times the bound"
    )
    assert bound - 3.0 * error < std < 1.1 * bound
    assert sampled > bound - 3.0 * error


def test_nobody_is_below_the_bound():
    scenario = with_(EXACT, information_set="full_state", winch__command_delay=1.9)
    bound = causal_bound(scenario)
    for kind in ("pid", "lqr", "feedforward", "feedforward_prediction", "feedforward_peaks", "lqg", "mpc"):
        sheave, payload, _ = left(scenario, kind, n_seas=16)
        print(f"{kind}: sheave {pooled(sheave)[0]:.4g}, payload {pooled(payload)[0]:.4g} m; {bound}")
        for values, least in ((sheave, bound.sheave_heave_std), (payload, bound.payload_heave_std)):
            std, error = pooled(values)
            assert std > least - 3.0 * error, kind


def test_a_forecast_is_worth_more_the_longer_the_delay():
    noisy = replace(
        THESIS,
        duration=250.0,
        sensors=tuple(replace(sensor, noise_std=0.01) for sensor in BOOM_TIP),
    )
    shares = []
    for delay in (0.1, 0.5):
        scenario = with_(noisy, winch__command_delay=delay)
        found = {
            kind: pooled(left(scenario, kind)[0])[0]
            for kind in ("feedforward", "feedforward_peaks", "feedforward_prediction")
        }
        print(delay, {kind: f"{value:.4f} m" for kind, value in found.items()})
        assert found["feedforward_prediction"] < found["feedforward_peaks"]
        assert found["feedforward_prediction"] < found["feedforward"]
        shares.append(found["feedforward_prediction"] / found["feedforward"])
    # With centimetres of noise the peaks' forecast pays where the delay is long.
    assert found["feedforward_peaks"] < found["feedforward"]
    assert shares[1] < shares[0]


def test_theory_predicts_the_running_feed_forward():
    noisy = replace(EXACT, sensors=tuple(replace(sensor, noise_std=0.01) for sensor in BOOM_TIP))
    for kind, options in (
        ("feedforward", {}),
        ("feedforward_prediction", {"aim": "middle"}),
        ("feedforward_prediction", {"aim": "end"}),
    ):
        std, error = pooled(left(noisy, kind, **options)[1])
        predicted = design(kind, noisy, **options).performance.payload_heave_std
        assert abs(std - predicted) < 4.0 * error, (kind, options)


def forecasts(scenario, motion, ahead):
    """The peaks' forecasts of a noise-free record, `ahead` steps on, once the record is full."""
    controller = feedforward_peaks(replace(scenario, sensors=BOOM_TIP))
    memory, found = np.zeros((motion.shape[1], controller.n_memory)), []
    first = controller.n_samples * controller.stride
    for now in motion[:-ahead]:
        _, memory = controller.respond(now[:, None], memory)
        modes = memory[:, controller.n_samples : -1]
        omega, cosine, sine = np.split(modes, 5, axis=1)[:3]
        # Memory stands one control step on.
        angle = omega * (ahead - 1) * scenario.control_dt
        found.append((cosine * np.cos(angle) - sine * np.sin(angle)).sum(axis=1))
    return np.array(found[first:]), motion[first + ahead :]


def test_a_few_sinusoids_are_forecast_by_their_peaks():
    time = 0.1 * np.arange(2000)
    motion = np.stack(
        [0.3 * np.sin(0.6 * time + 1.0) + 0.2 * np.sin(0.95 * time), 0.4 * np.cos(0.8 * time)], axis=1
    )
    forecast, truth = forecasts(THESIS, motion, 20)
    # Two seconds ahead; what is left is the grid of frequencies, which the observer makes good.
    assert np.std(forecast - truth) < 0.03 * np.std(truth)
    assert N_MODES >= 2


def test_the_peaks_forecast_of_the_thesis_s_sea_is_good_for_a_second():
    motion = simulate(THESIS, seeds=range(8), duration=250.0)["boom_tip_heave"]
    error = {}
    for ahead in (1, 5, 10):
        forecast, truth = forecasts(THESIS, motion, ahead)
        error[ahead] = np.std(forecast - truth) / np.std(truth)
    print({f"{0.1 * ahead:.1f} s": f"{value:.4f}" for ahead, value in error.items()})
    assert error[1] < 0.005 and error[5] < 0.05 and error[10] < 0.15
