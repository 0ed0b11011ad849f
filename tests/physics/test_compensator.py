"""The passive compensator: closed forms of its response, its limits, and that locked it is not there."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from baselines import design
from experiments.metrics import scores, window
from experiments.rollout import rollout
from heave_env.parameters import Compensator
from heave_env.plant import simulate
from heave_env.scenarios import Scenario, load

ROD = Compensator(gas_volume=2.0, piston_area=0.05, stroke=6.0, damping=2e4)


def swell(omega: float, height: float, compensator: Compensator | None, **cable) -> Scenario:
    """A short, stiff, light cable in a regular sea, so that gas and damper are all that gives."""
    scenario = load("sea_state_5")
    assert scenario.cable is not None
    made = {"mass_per_length": 0.01, "submerged_weight": 0.0, "axial_stiffness": 1e9}
    made |= {"tangential_drag_coefficient": 0.0} | cable
    return dataclasses.replace(
        scenario,
        start="hanging",
        vessel=None,
        length=50.0,
        n_elements=4,
        n_substeps=4,
        sea_state=dataclasses.replace(
            scenario.sea_state, kind="regular", peak_omega=omega, significant_wave_height=height
        ),
        cable=dataclasses.replace(scenario.cable, **made),
        payload=dataclasses.replace(
            scenario.payload, mass=20_000.0, submerged_weight=50_000.0, drag_area=0.0
        ),
        compensator=compensator,
    )


def phasor(time: np.ndarray, series: np.ndarray, omega: float) -> complex:
    """Amplitude and phase of a frequency in the last two fifths of a series."""
    late = time > 0.6 * time[-1]
    waves = np.column_stack([np.cos(omega * time), np.sin(omega * time), np.ones_like(time)])[late]
    cosine, sine, _ = np.linalg.lstsq(waves, series[late], rcond=None)[0]
    return complex(cosine, -sine)


@pytest.mark.parametrize("moving_mass", [0.0, 3000.0])
@pytest.mark.parametrize("omega", [0.3, 0.6, 1.2])
def test_small_motion_is_spring_and_damper_in_series_with_the_payload(omega, moving_mass):
    rod = dataclasses.replace(ROD, moving_mass=moving_mass)
    scenario = swell(omega, 0.02, rod)
    record = simulate(scenario, seeds=[0], duration=400.0)
    time = record["time"]
    boom_tip = phasor(time, record["boom_tip_heave"][:, 0], omega)
    payload = phasor(time, record["payload_heave"][:, 0], omega)
    # The rod's own mass moves with its extension alone, as the module's equation says.
    k, d, M, m = rod.stiffness(50_000.0), rod.damping, 20_000.0, moving_mass
    link = k + 1j * omega * d - m * omega**2
    exact = link / (link - M * omega**2)
    # The cable's own spring, 1e9/50 N/m, is 3e-4 of the gas's flexibility.
    assert payload / boom_tip == pytest.approx(exact, abs=2e-3 * max(1.0, abs(exact)))


def test_it_lessens_the_motion_above_its_own_frequency():
    locked = simulate(swell(1.0, 2.0, None), seeds=[0], duration=300.0)["payload_heave"][1500:]
    light = dataclasses.replace(ROD, damping=4e3)
    soft = simulate(swell(1.0, 2.0, light), seeds=[0], duration=300.0)["payload_heave"][1500:]
    # |k + iωd| / |k + iωd - Mω²| with k = 1625 N/m: 0.23 of the motion is left.
    assert soft.std() == pytest.approx(0.23 * locked.std(), rel=0.05)


def test_a_damper_that_cannot_move_is_no_compensator():
    stiff = dataclasses.replace(ROD, damping=1e12)
    with_rod = simulate(swell(0.8, 2.0, stiff), seeds=[0], duration=60.0)
    without = simulate(swell(0.8, 2.0, None), seeds=[0], duration=60.0)
    assert with_rod["payload_heave"] == pytest.approx(without["payload_heave"], abs=1e-5)
    assert np.abs(with_rod["compensator_displacement"]).max() < 1e-5


def test_the_rod_stops_at_its_stroke():
    short = dataclasses.replace(ROD, stroke=0.5)
    record = simulate(swell(0.8, 4.0, short), seeds=[0], duration=100.0)
    assert np.abs(record["compensator_displacement"]).max() == pytest.approx(0.25)
    assert np.isfinite(record["payload_heave"]).all()


def test_sheave_energy_goes_into_gas_and_damper():
    # Over whole periods of a steady state the gas returns what it took: work on the rod is damping.
    omega = 0.8
    scenario = swell(omega, 1.0, ROD)
    record = simulate(scenario, seeds=[0], duration=400.0)
    per_period = round(2.0 * math.pi / omega / 0.1 * 10)  # ten periods, in control steps
    late = slice(-per_period - 1, None)
    rate = record["compensator_rate"][late, 0]
    tension = record["sheave_tension"][late, 0]
    damped = ROD.damping * np.mean(rate**2)
    # Tension pulls the rod down: its work on the rod, less what the boom tip brings.
    assert -np.mean((tension - tension.mean()) * rate) == pytest.approx(damped, rel=0.02)


def test_a_slack_cable_leaves_the_rod_to_the_gas():
    snapping = dict(tension_only=True, axial_damping=5e6)
    record = simulate(swell(2.2, 5.0, ROD, **snapping), seeds=[0], duration=60.0)
    assert record["slack"].max() == 1.0
    assert np.isfinite(record["payload_heave"]).all()
    assert np.abs(record["compensator_displacement"]).max() <= 3.0


def test_row_of_a_batch_is_the_single_environment():
    scenario = dataclasses.replace(load("sea_state_5"), compensator=ROD)
    batch = simulate(scenario, seeds=[5, 6, 7], duration=20.0)
    single = simulate(scenario, seeds=[6], duration=20.0)
    for channel in ("payload_heave", "compensator_displacement", "sheave_tension"):
        assert np.array_equal(batch[channel][:, 1], single[channel][:, 0])


@pytest.mark.slow
def test_hybrid_needs_less_energy_than_the_winch_alone_and_leaves_no_more_motion():
    # `pytest -s` prints standard deviation and energy of each, means over eight test seas.
    seeds = [20_000_000 + i for i in range(8)]
    found = {}
    for label, compensator in (("winch alone", None), ("hybrid", load("hybrid").compensator)):
        scenario = dataclasses.replace(load("hybrid"), compensator=compensator)
        for name in ("none", "lqg"):
            run = rollout(scenario, design(name, scenario), seeds)
            row = scores(run, window(scenario.duration, scenario.control_dt))
            found[label, name] = [float(row[key].mean()) for key in ("payload_heave_std", "supply_energy")]
            std, energy = found[label, name]
            print(f"\n{label}, {name}: payload {1e3 * std:.2f} mm, supply {energy:.3f} kWh", end="")
    assert found["hybrid", "none"][0] < 0.05 * found["winch alone", "none"][0]
    assert found["hybrid", "lqg"][0] < found["winch alone", "lqg"][0]
    assert found["hybrid", "lqg"][1] < 0.9 * found["winch alone", "lqg"][1]


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"stroke": 90.0}, "stroke must be below twice the gas column of 40 m"),
        ({"gas_volume": 0.0}, "gas_volume must be a positive number"),
        ({"damping": -1.0}, "damping must be a number that is not negative"),
    ],
)
def test_impossible_compensators_are_refused(changes, complaint):
    with pytest.raises(ValueError, match=complaint):
        dataclasses.replace(ROD, **changes)


def test_a_linear_payload_has_no_tension_to_act_on():
    with pytest.raises(ValueError, match="compensator must be null with a linear_payload"):
        dataclasses.replace(load("thesis_linear"), compensator=ROD)


def test_pressure_ratio_is_that_of_the_gas_law():
    assert ROD.pressure_ratio == pytest.approx((43.0 / 37.0) ** 1.3)
