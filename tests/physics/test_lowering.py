"""Lowering mechanics: what it refuses, what must hold for any cable, and the contract of its records."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.cases.lowering import deep_lowering, hydrographic_package, hydrographic_wire
from heave_env.cable.convergence import ConvergenceError
from heave_env.cable.lowering import Lowering, expected_extreme
from heave_env.parameters import Cable, Payload, SeaState, Vessel

LIGHT = Lowering(cable=hydrographic_wire(), payload=hydrographic_package())
CALM = SeaState(kind="calm")

few = settings(max_examples=25, deadline=None, derandomize=True)


def between(low, high):
    return st.floats(low, high, allow_nan=False)


def random_sea(height, omega=0.9):
    return SeaState(kind="random_phase", significant_wave_height=height, peak_omega=omega)


@st.composite
def lowerings(draw):
    cable = Cable(
        mass_per_length=draw(between(0.05, 30.0)),
        axial_stiffness=draw(between(1e6, 3e8)),
        submerged_weight=draw(between(0.1, 200.0)),
        diameter=draw(between(0.005, 0.1)),
        tangential_drag_coefficient=draw(between(0.001, 0.02)),
        breaking_strength=1e7,
    )
    weight = draw(between(200.0, 5e5))
    payload = Payload(
        mass=weight / 7.0,
        added_mass=draw(between(0.0, weight / 7.0)),
        submerged_weight=weight,
        drag_area=draw(between(0.1, 30.0)),
    )
    return Lowering(cable=cable, payload=payload)


def with_cable(**changes):
    return dataclasses.replace(LIGHT, cable=dataclasses.replace(LIGHT.cable, **changes))


# Bad input -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("deed", "sentence"),
    [
        (
            lambda: Lowering(cable=LIGHT.cable, payload=Payload(mass=1.0, submerged_weight=-5.0)),
            "submerged_weight",
        ),
        (lambda: LIGHT.tension(-1.0), "arc_length must be finite and not negative, got -1.0"),
        (lambda: LIGHT.tension(10.0, math.nan), "payout_rate must be a finite number, got nan"),
        (lambda: LIGHT.profile(0.0), "length must be a positive number, got 0.0"),
        (lambda: LIGHT.elongation(math.inf), "length must be finite"),
        (lambda: with_cable(breaking_strength=None).safety_factor(10.0), "breaking_strength must be given"),
        (lambda: LIGHT.greatest_length(0.0), "safety_factor must be a positive number, got 0.0"),
        (lambda: LIGHT.in_sea(100.0, CALM, exposure=0.0), "exposure must be a positive number"),
        (lambda: LIGHT.payout_limits([100.0], [CALM], margin=1.0), "margin must be at least 0 and below 1"),
        (lambda: LIGHT.payout_limits([0.0], [CALM]), "lengths must be a positive number"),
        (lambda: LIGHT.in_sea(100.0, CALM, n_points=1), "n_points must be at least 2, got 1"),
        (lambda: LIGHT.inertia_force(math.inf), "acceleration must be a finite number"),
        (lambda: LIGHT.spring_constant(-2.0), "length must be a positive number"),
        (lambda: LIGHT.free_fall_speed(-2.0), "distance must be finite and not negative"),
        (lambda: LIGHT.simulate(100.0, np.zeros(5), 0.0), "dt must be a positive number"),
        (lambda: LIGHT.simulate(0.0, np.zeros(5), 0.1), "length must stay positive"),
        (lambda: LIGHT.simulate(100.0, np.array([0.0, math.nan]), 0.1), "at least two finite numbers"),
        (
            lambda: LIGHT.simulate(100.0, np.zeros(5), 0.1, cable_mass_share=2.0),
            "cable_mass_share must lie in",
        ),
        (lambda: LIGHT.simulate(100.0, np.zeros(5), 0.1, n_elements=5), "axial_damping must be positive"),
        (lambda: LIGHT.simulate(100.0, np.zeros(5), 0.1, n_elements=0), "n_elements"),
        (
            lambda: LIGHT.simulate(100.0, np.zeros(5), 0.1).after(9.0),
            "time must lie within the record of 0.4 s",
        ),
    ],
)
def test_bad_input_is_named_with_its_value(deed, sentence):
    with pytest.raises(ValueError, match=sentence):
        deed()


def test_resonance_without_any_damping_is_named():
    cable = dataclasses.replace(LIGHT.cable, mass_per_length=0.0, tangential_drag_coefficient=0.0)
    payload = dataclasses.replace(LIGHT.payload, drag_area=0.0)
    lowering = Lowering(cable=cable, payload=payload)
    natural = math.sqrt(lowering.spring_constant(1000.0) / payload.inertia)
    sea = SeaState(kind="regular", significant_wave_height=1.0, peak_omega=natural)
    with pytest.raises(ConvergenceError, match="resonates"):
        lowering.in_sea(1000.0, sea)


# What must hold for any cable ----------------------------------------------------------------------


@few
@given(lowerings(), between(10.0, 6000.0), between(-3.0, 3.0))
def test_elongation_is_the_integrated_strain(lowering, length, rate):
    profile = lowering.profile(length, rate, n_points=2001)
    strain = profile.tension / lowering.cable.axial_stiffness
    integrated = np.sum(0.5 * (strain[1:] + strain[:-1]) * np.diff(profile.arc_length))
    scale = np.abs(strain).max() * length
    assert profile.elongation[-1] == pytest.approx(integrated, abs=1e-9 * scale)  # tension is linear: exact


@few
@given(lowerings(), between(1.1, 6.0), between(-3.0, 0.0))
def test_the_greatest_length_has_the_factor_of_safety_asked_for(lowering, factor, rate):
    length = lowering.greatest_length(factor, rate)
    assert lowering.safety_factor(length, rate) == pytest.approx(factor, rel=1e-9)


@few
@given(lowerings(), between(0.01, 6.0))
def test_slack_length_parts_taut_from_slack(lowering, rate):
    slack = lowering.slack_length(rate)
    if slack == 0.0:
        assert lowering.tension(0.0, rate) <= 0.0
    elif math.isinf(slack):
        assert (lowering.tension(np.array([0.0, 1e3, 1e5]), rate) > 0.0).all()
    else:
        size = lowering.payload.submerged_weight
        assert lowering.tension(slack, rate) == pytest.approx(0.0, abs=1e-6 * size)
        assert lowering.tension(0.9 * slack, rate) > 0.0 > lowering.tension(1.1 * slack, rate)


@few
@given(lowerings(), between(0.0, 6000.0))
def test_at_terminal_velocity_the_sheave_bears_nothing(lowering, length):
    rate = float(lowering.terminal_velocity(length))
    assert lowering.tension(length, rate) == pytest.approx(0.0, abs=1e-9 * float(lowering.tension(length)))


@few
@given(lowerings(), between(50.0, 3000.0), between(0.05, 1.0), between(-1.0, 1.0))
def test_a_sea_widens_the_range_about_its_mean(lowering, length, height, rate):
    found = lowering.in_sea(length, random_sea(height), payout_rate=rate, n_points=5)
    assert (found.highest >= found.mean).all() and (found.lowest <= found.mean).all()
    # Extremes of an hour exceed the significant amplitude, two standard deviations.
    assert (found.highest - found.mean >= found.amplitude).all()
    assert np.isfinite([found.peak, found.least, found.payload_heave]).all()


@few
@given(lowerings(), between(50.0, 3000.0), between(-2.0, 2.0))
def test_a_vanishing_swell_is_the_quasi_static_tension(lowering, length, rate):
    ripple = SeaState(kind="regular", significant_wave_height=1e-9, peak_omega=0.3)
    found, calm = (lowering.in_sea(length, sea, payout_rate=rate) for sea in (ripple, CALM))
    scale = float(np.abs(calm.mean).max())
    assert found.highest == pytest.approx(calm.highest, abs=1e-5 * scale)
    assert found.lowest == pytest.approx(calm.lowest, abs=1e-5 * scale)


def test_rougher_seas_pull_harder_and_allow_less():
    seas = [CALM, *(random_sea(height) for height in (0.25, 0.5, 1.0))]
    vessel = Vessel(natural_omega=0.9, damping_ratio=0.4, gain=0.7)
    lengths = [200.0, 1500.0, 4000.0]
    peaks = LIGHT.peak_tensions(lengths, seas, vessel=vessel)
    limits = LIGHT.payout_limits(lengths, seas, vessel=vessel)
    assert peaks.peak.shape == limits.rate.shape == (4, 3)
    assert (np.diff(peaks.peak, axis=0) > 0.0).all()
    assert (np.diff(peaks.least, axis=0) < 0.0).all()
    assert (np.diff(limits.rate, axis=0) <= 0.0).all()


def test_a_payout_limit_keeps_its_margin_and_no_more():
    sea = random_sea(0.5)
    for margin in (0.1, 0.4):
        rate = LIGHT.payout_limits([1000.0], [sea], margin=margin).rate[0, 0]
        least = LIGHT.in_sea(1000.0, sea, payout_rate=rate, n_points=11).least
        assert least == pytest.approx(margin * LIGHT.payload.submerged_weight, rel=1e-3)


def test_no_rate_is_allowed_where_a_stopped_winch_goes_slack():
    assert LIGHT.payout_limits([500.0], [random_sea(5.0)]).rate[0, 0] == 0.0
    assert not LIGHT.in_sea(500.0, random_sea(5.0)).stays_taut


def test_any_rate_is_allowed_where_nothing_drags():
    cable = dataclasses.replace(LIGHT.cable, tangential_drag_coefficient=0.0)
    free = Lowering(cable=cable, payload=dataclasses.replace(LIGHT.payload, drag_area=0.0))
    assert math.isinf(free.payout_limits([500.0], [CALM]).rate[0, 0])
    assert np.isinf(free.terminal_velocity(np.array([0.0, 100.0]))).all()


def test_a_buoyant_cable_has_a_length_that_carries_it_no_further():
    floating = with_cable(submerged_weight=-0.5)
    length = floating.slack_length(0.0)
    assert length == pytest.approx(LIGHT.payload.submerged_weight / 0.5)
    assert floating.terminal_velocity(2.0 * length) == 0.0
    assert math.isinf(floating.greatest_length())


def test_expected_extreme_of_a_thousand_waves():
    # sqrt(2 ln 1000) = 3.7169, 0.5772 / 3.7169 = 0.1553.
    assert expected_extreme(8000.0, 8.0) == pytest.approx(3.8722, abs=1e-4)


# The march -----------------------------------------------------------------------------------------


def swung(n_elements=1, dt=0.02, damping=0.0):
    lowering = with_cable(axial_damping=damping)
    time = dt * np.arange(round(20.0 / dt) + 1)
    return lowering.simulate(800.0, 0.2 * np.sin(1.2 * time), dt, n_elements=n_elements)


def test_at_rest_nothing_moves():
    record = LIGHT.simulate(800.0, np.zeros(50), 0.1)
    assert np.abs(record.payload_heave).max() < 1e-9
    assert record.payload_tension == pytest.approx(LIGHT.payload.submerged_weight)
    assert record.sheave_tension == pytest.approx(float(LIGHT.tension(800.0)))
    assert record.slack_share == 0.0 and record.n_snaps == 0


def test_the_march_changes_none_of_its_arguments_and_repeats_itself():
    heave, length = 0.3 * np.sin(np.arange(200) * 0.05), np.full(200, 500.0)
    kept = heave.copy(), length.copy()
    first, second = (LIGHT.simulate(length, heave, 0.05) for _ in range(2))
    assert np.array_equal(heave, kept[0]) and np.array_equal(length, kept[1])
    assert np.array_equal(first.payload_tension, second.payload_tension)
    first.sheave_heave[:] = 0.0
    assert np.array_equal(second.sheave_heave, heave)


def test_tension_is_never_negative_and_the_record_is_finite_in_a_violent_sea():
    time = 0.005 * np.arange(8001)
    record = LIGHT.simulate(300.0, 3.0 * np.sin(2.0 * time), 0.005)
    assert record.payload_tension.min() == 0.0
    assert record.n_snaps > 3
    assert np.isfinite(record.payload_heave).all()


def test_a_cable_with_little_mass_of_its_own_is_the_massless_spring():
    light = with_cable(
        mass_per_length=1e-4, submerged_weight=0.0, tangential_drag_coefficient=0.0, axial_damping=1e-3
    )
    time = 0.01 * np.arange(2001)
    heave = 0.2 * np.sin(1.2 * time)
    spring, rod = (light.simulate(800.0, heave, 0.01, n_elements=n) for n in (1, 8))
    assert rod.payload_heave == pytest.approx(spring.payload_heave, abs=1e-4)


def test_a_record_is_cut_with_its_instants():
    record = swung()
    late = record.after(10.0)
    assert late.time[0] >= 10.0
    assert late.payload_tension[-1] == record.payload_tension[-1]
    assert len(late.time) == len(late.sheave_tension)


def test_a_snap_that_is_not_resolved_raises_and_names_the_step(monkeypatch):
    from heave_env.cable import lowering as module

    solved = module.AxialSolver.simulate

    def unsettled(self, *args, **kwargs):
        record = solved(self, *args, **kwargs)
        return dataclasses.replace(record, payload_tension=1.01 * record.payload_tension)

    monkeypatch.setattr(module.AxialSolver, "simulate", unsettled)
    with pytest.raises(ConvergenceError, match="take a smaller dt"):
        LIGHT.simulate(300.0, np.zeros(10), 0.1)


def test_the_deep_plan_reaches_the_safe_load_in_no_table():
    # A designer's check of the named case: safety factor three holds to 3000 m in every sea of the table.
    outcome = deep_lowering().outcome()
    numbers = {quantity.name: quantity.value for quantity in outcome.quantities}
    assert numbers["peak_tension"] < 5.0e6 / 3.0
    assert numbers["greatest_length_in_the_roughest_sea"] == 3000.0
