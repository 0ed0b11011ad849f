"""Sea and vessel: spectra, the shaping filter, its exact discretisation, and recorded motions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from heave_env.parameters import SeaState, peak_omega_of_zero_crossing_period
from heave_env.plant import simulate
from heave_env.scenarios import Scenario, load
from heave_env.sea import bretschneider, read_motion, square_root, wave_filter
from heave_env.vessel import boom_tip_components, boom_tip_filter, boom_tip_spectrum, heave_response

OMEGA = np.linspace(1e-3, 12.0, 40_000)
THESIS_SEA = SeaState(significant_wave_height=3.048, peak_omega=0.785)


def thesis_boom_tip():
    scenario = load("thesis_linear")
    return boom_tip_filter(scenario.sea_state, scenario.vessel)


def test_bretschneider_holds_the_variance_of_its_significant_height():
    variance = np.trapezoid(bretschneider(OMEGA, 3.048, 0.785), OMEGA)
    assert variance == pytest.approx(3.048**2 / 16.0, rel=1e-3)


def test_bretschneider_peaks_at_its_modal_frequency():
    assert OMEGA[np.argmax(bretschneider(OMEGA, 2.0, 0.9))] == pytest.approx(0.9, abs=1e-3)


def test_zero_crossing_period_is_that_of_the_spectrum():
    # The fourth moment diverges slowly but the second converges: integrate far out.
    omega = np.geomspace(1e-2, 1e4, 400_000)
    S = bretschneider(omega, 6.0, peak_omega_of_zero_crossing_period(14.0))
    m0, m2 = np.trapezoid(S, omega), np.trapezoid(omega**2 * S, omega)
    assert 2.0 * np.pi * np.sqrt(m0 / m2) == pytest.approx(14.0, rel=1e-3)


def test_shaping_filter_has_the_published_elevation():
    # tests/reference/SOURCES.md: 0.7377 m for Hs 3.048 m, 94 % of the variance of the true spectrum.
    wave = wave_filter(THESIS_SEA)
    variance = (wave.C @ wave.covariance @ wave.C.T)[0, 0]
    assert np.sqrt(variance) == pytest.approx(0.7377, abs=1e-4)
    assert variance / THESIS_SEA.variance == pytest.approx(0.94, abs=0.005)


def test_shaping_filter_is_the_rational_spectrum():
    # Huang (1992), (6.21): S0 (w/w0)^4 / [1 + (w/w0)^4]^3.
    S0 = 1.25 / (4.0 * 0.785) * 3.048**2 * 1.8861
    ratio = OMEGA / (0.9538 * 0.785)
    rational = S0 * ratio**4 / (1.0 + ratio**4) ** 3
    ours = np.abs(wave_filter(THESIS_SEA).response(OMEGA)[:, 0]) ** 2
    # 1.414 stands for sqrt(2), which moves the peak by 1e-3.
    assert ours == pytest.approx(rational, rel=2e-3, abs=1e-6)


def test_boom_tip_has_the_published_deviation_in_theory():
    boom_tip = thesis_boom_tip()
    assert np.sqrt((boom_tip.C @ boom_tip.covariance @ boom_tip.C.T)[0, 0]) == pytest.approx(0.1722, abs=5e-5)
    scenario = load("thesis_linear")
    spectrum = boom_tip_spectrum(OMEGA, scenario.sea_state, scenario.vessel)
    assert np.sqrt(np.trapezoid(spectrum, OMEGA)) == pytest.approx(0.1722, abs=5e-5)


def test_payload_has_the_published_deviation_in_theory():
    assert load("thesis_linear").uncontrolled_payload_std == pytest.approx(0.2551, abs=5e-5)


def test_running_environment_has_both_published_deviations():
    record = simulate(load("thesis_linear"), seeds=range(256), duration=400.0)
    late = record["time"] > 100.0
    for channel, published in (("boom_tip_heave", 0.1722), ("payload_heave", 0.2551)):
        per_sea = np.mean(record[channel][late] ** 2, axis=0)
        standard_error = per_sea.std(ddof=1) / np.sqrt(len(per_sea))
        assert per_sea.mean() == pytest.approx(published**2, abs=3.0 * standard_error)
        assert standard_error / per_sea.mean() < 0.04


def test_sea_is_stationary_from_the_first_instant():
    record = simulate(load("thesis_linear"), seeds=range(4000), duration=1.0)
    for channel, scale in (("boom_tip_heave", 0.1722), ("boom_tip_heave_rate", 0.0898)):
        # The standard error of a deviation of 4000 samples is 1.1 %.
        assert record[channel][0].std() == pytest.approx(scale, rel=0.035)
        assert record[channel][-1].std() == pytest.approx(scale, rel=0.035)


@pytest.mark.parametrize("dt", [0.01, 0.1, 1.0])
def test_discretisation_keeps_the_stationary_covariance(dt):
    boom_tip = thesis_boom_tip()
    F, Q = boom_tip.discretised(dt)
    assert F @ boom_tip.covariance @ F.T + Q == pytest.approx(boom_tip.covariance, abs=1e-10)


def test_two_half_steps_are_one_step():
    boom_tip = thesis_boom_tip()
    F, Q = boom_tip.discretised(0.1)
    half, noise = boom_tip.discretised(0.05)
    assert half @ half == pytest.approx(F, abs=1e-12)
    assert half @ noise @ half.T + noise == pytest.approx(Q, abs=1e-14)


def test_noise_factor_squares_to_the_covariance():
    _, Q = thesis_boom_tip().discretised(0.1)
    size = np.sqrt(np.diag(Q))
    factor = square_root(Q)
    assert (factor @ factor.T) / np.outer(size, size) == pytest.approx(Q / np.outer(size, size), abs=1e-11)
    assert np.all(np.triu(factor, 1) == 0.0)


def test_running_sea_has_the_filters_autocorrelation():
    boom_tip = thesis_boom_tip()
    record = simulate(load("thesis_linear"), seeds=range(400), duration=100.0)["boom_tip_heave"]
    for steps in (10, 30, 60):
        F, _ = boom_tip.discretised(0.1 * steps)
        exact = (boom_tip.C @ F @ boom_tip.covariance @ boom_tip.C.T)[0, 0]
        products = (record[steps:] * record[:-steps]).mean(axis=0)
        assert products.mean() == pytest.approx(exact, abs=4.0 * products.std() / np.sqrt(400))


def test_random_phase_sea_has_the_spectrum():
    scenario = load("thesis_regulator")
    components = boom_tip_components(scenario.sea_state, None)
    assert 0.5 * np.sum(components.amplitude**2) == pytest.approx(6.0**2 / 16.0, rel=1e-9)
    edge = np.searchsorted(OMEGA, components.low[64])
    below = np.trapezoid(bretschneider(OMEGA[:edge], 6.0, scenario.sea_state.peak_omega), OMEGA[:edge])
    assert below / (6.0**2 / 16.0) == pytest.approx(0.5, abs=0.01)


def test_running_random_phase_sea_and_its_rate():
    record = simulate(load("thesis_regulator"), seeds=range(200), duration=100.0)
    heave, rate = record["boom_tip_heave"], record["boom_tip_heave_rate"]
    assert heave.std() == pytest.approx(1.5, rel=0.03)
    # A central difference over 0.1 s of motion at 0.4 rad/s is good to 1e-3.
    assert (heave[2:] - heave[:-2]) / 0.2 == pytest.approx(rate[1:-1], abs=0.01)


def test_regular_sea_is_one_sinusoid():
    record = simulate(load("snap"), seeds=[3], duration=20.0)
    heave = record["boom_tip_heave"][:, 0]
    basis = np.column_stack([np.cos(0.5 * np.pi * record["time"]), np.sin(0.5 * np.pi * record["time"])])
    weights = np.linalg.lstsq(basis, heave, rcond=None)[0]
    assert np.hypot(*weights) == pytest.approx(7.0 * 0.3048, rel=1e-9)
    assert heave == pytest.approx(basis @ weights, abs=1e-9)


def test_vessel_passes_slow_waves_with_its_gain():
    vessel = load("thesis_linear").vessel
    assert heave_response(np.array([1e-6]), vessel)[0] == pytest.approx(0.5, rel=1e-4)


def write(path, text: str):
    path.write_text(text)
    return path


def recorded(path) -> Scenario:
    scenario = load("thesis_cable")
    return dataclasses.replace(
        scenario, sea_state=SeaState(kind="recorded", recording=str(path)), duration=10.0
    )


def test_recorded_motion_is_replayed_through_its_samples(tmp_path):
    time = np.arange(0.0, 12.01, 0.37)
    rows = "\n".join(f"{t},{np.sin(t)},{0.1 * t}" for t in time)
    path = write(tmp_path / "motion.csv", f"# a comment\ntime,heave,payout\n{rows}\n")
    record = simulate(recorded(path), seeds=[0])
    # A cubic spline of sin t sampled at 0.37 s is good to 0.37^4 / 384.
    assert record["boom_tip_heave"][:, 0] == pytest.approx(np.sin(record["time"]), abs=2e-4)
    assert record["payout"][:, 0] == pytest.approx(0.1 * record["time"], abs=1e-12)
    assert record["length"][:, 0] == pytest.approx(900.0 + 0.1 * record["time"], abs=1e-9)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("time,surge\n0,1\n", "lacks the column 'heave'"),
        ("time,heave\n0,1\n1,\n2,1\n3,1\n4,1\n", "line 3: heave is ''"),
        ("time,heave\n0,1\n1,nan\n2,1\n3,1\n4,1\n", "line 3: heave is 'nan'"),
        ("time,heave\n0,1\n2,1\n1,1\n3,1\n4,1\n", "line 4: time 1 s does not come after 2 s"),
        ("time,heave\n0,1\n1,1\n", "give at least 4"),
    ],
)
def test_bad_motion_files_are_refused_in_a_sentence(tmp_path, text, complaint):
    with pytest.raises(ValueError, match=complaint):
        read_motion(write(tmp_path / "motion.csv", text))


def test_a_run_past_the_end_of_its_recording_is_refused(tmp_path):
    path = write(tmp_path / "motion.csv", "time,heave\n0,0\n1,0\n2,0\n3,0\n")
    with pytest.raises(ValueError, match=r"lasts 3 s, the run 10 s"):
        simulate(recorded(path), seeds=[0])
