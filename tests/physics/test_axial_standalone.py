"""The axial cable as a simulator of its own: what it records, how it goes on, what it refuses."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
import time as clock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.cases.axial import (
    Lowering,
    example_five,
    paid_out,
    thesis_sphere_in_water,
)
from experiments.validation.thesis_scheme import ThesisScheme
from heave_env.cable.axial import AxialSolver
from heave_env.cable.closed_form import natural_omegas, resonant_length
from heave_env.cable.convergence import ConvergenceError
from heave_env.parameters import Cable, Payload

CASE = example_five(duration=1.0)
SLACK = dataclasses.replace(CASE.cable, tension_only=True)
DT = 0.05


def solver(**changes: object) -> AxialSolver:
    settings = {"cable": CASE.cable, "payload": CASE.payload, "length": 300.0, **changes}
    return AxialSolver(**settings)


def heave(n_steps: int, amplitude: float = 1.0) -> np.ndarray:
    return amplitude * np.sin(1.1 * DT * np.arange(n_steps + 1))


def test_record_holds_the_extremes_of_both_ends_and_of_every_element():
    record = solver().simulate(heave(400, amplitude=0.2), DT)
    assert np.all(record.tension_min <= np.minimum(record.sheave_tension, record.payload_tension))
    assert np.all(record.tension_max >= np.maximum(record.sheave_tension, record.payload_tension))
    assert record.element_tension_min.shape == record.element_share.shape == (20,)
    # From the payload up: the top carries the cable's weight beside the payload's.
    assert record.element_tension_max[-1] > record.element_tension_max[0]
    assert record.element_tension_max.max() <= record.tension_max.max()
    assert record.slack_fraction == 0.0


def test_a_march_goes_on_where_another_ended():
    motion, length = heave(200), 300.0 + 0.05 * np.arange(201)
    whole = solver().simulate(motion, DT, length)
    first = solver().simulate(motion[:101], DT, length[:101])
    second = solver().simulate(motion[100:], DT, length[100:], start=first.final)
    assert np.array_equal(second.payload_displacement, whole.payload_displacement[100:])
    assert np.array_equal(second.sheave_tension[1:], whole.sheave_tension[101:])
    assert second.final == whole.final


def test_states_copy_compare_and_pickle():
    record = solver().simulate(heave(20), DT)
    for twin in (copy.deepcopy(record.final), pickle.loads(pickle.dumps(record.final))):
        assert twin == record.final
    assert record.final != solver().rest()
    before = record.final.buffer.copy()
    solver().step(record.final, (0.2, 300.1), DT)
    solver().profile(record.final)
    solver().top_tension(record.final)
    assert np.array_equal(record.final.buffer, before)


def test_arguments_are_left_as_they_were():
    motion, length = heave(50), np.full(51, 300.0)
    kept = motion.copy()
    record = solver().simulate(motion, DT, length)
    motion[:] = 7.0
    assert np.array_equal(record.sheave_heave, kept)
    assert np.all(length == 300.0)


def test_profile_runs_from_the_payload_to_the_sheave():
    one = solver()
    record = one.simulate((0.2 * DT * np.arange(101)) ** 4, DT)
    profile = one.profile(record.final)
    assert profile.arc_length[0] == 0.0 and profile.arc_length[-1] == 300.0
    assert profile.height[-1] == pytest.approx(record.sheave_heave[-1])
    assert profile.tension[0] == record.payload_tension[-1]
    assert profile.tension[-1] == record.sheave_tension[-1]
    assert profile.velocity[0] == record.payload_velocity[-1]
    # The sheave's own velocity is extrapolated from the material beneath it, linearly.
    assert profile.velocity[-1] == pytest.approx(4.0 * 0.2, abs=0.02)
    expected = -300.0 - one.static_stretch(300.0) + record.payload_displacement[-1]
    assert profile.height[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((np.zeros(5), 0.0, None), "dt must be a positive number"),
        ((np.zeros(5), math.nan, None), "dt must be a positive number"),
        ((np.zeros((5, 2)), DT, None), "sheave_heave must be one row"),
        ((np.zeros(0), DT, None), "sheave_heave must be one row"),
        ((np.array([0.0, np.nan]), DT, None), "fill the gaps"),
        ((np.zeros(5), DT, np.full(4, 300.0)), "length must have an instant for each"),
        ((np.zeros(3), DT, np.array([1.0, 0.5, 0.0])), "recover less or start from more"),
        ((np.zeros(2), DT, np.array([300.0, np.inf])), "length must be positive"),
    ],
)
def test_impossible_motion_is_refused_with_a_sentence(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        solver().simulate(*arguments)


def test_a_start_that_does_not_fit_is_refused():
    final = solver().simulate(heave(10), DT).final
    with pytest.raises(ValueError, match="let it begin there"):
        solver().simulate(np.zeros(5), DT, np.full(5, 250.0), start=final)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"length": -1.0}, "AxialSolver.length must be a positive number"),
        ({"n_elements": 0}, "AxialSolver.n_elements must be an integer of at least 1"),
        ({"payload": Payload(mass=1.0, submerged_weight=-5.0)}, "submerged_weight must be a positive number"),
        (
            {"cable": dataclasses.replace(CASE.cable, mass_per_length=0.0)},
            "n_elements must be 1 for a massless cable",
        ),
    ],
)
def test_impossible_parameters_are_refused_with_a_sentence(changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        solver(**changes)


def test_a_motion_beyond_all_numbers_says_so_in_place_of_nan():
    with pytest.raises(ConvergenceError, match="check the motion for jumps"):
        solver(cable=SLACK).simulate(np.array([0.0, 1e200, -1e250, 1e300]), DT)


def test_more_iterations_than_it_takes_change_nothing_of_a_slack_cable():
    # Over the first snaps: without damping, snapping is chaotic and rounding grows with every one.
    motion = heave(150, amplitude=4.0)
    few, many = (solver(cable=SLACK, n_iterations=n).simulate(motion, DT) for n in (1, 12))
    assert few.slack_fraction > 0.1
    assert few.payload_displacement == pytest.approx(many.payload_displacement, abs=1e-6)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    amplitude=st.floats(0.0, 5.0),
    omega=st.floats(0.2, 6.0),
    speed=st.floats(-1.5, 3.0),
    n_elements=st.integers(2, 40),
    relaxation=st.sampled_from([0.0, 0.005]),
    dt=st.sampled_from([0.01, 0.05, 0.2]),
)
def test_a_slack_cable_never_pushes_and_never_loses_its_numbers(
    amplitude, omega, speed, n_elements, relaxation, dt
):
    cable = dataclasses.replace(SLACK, axial_damping=relaxation * SLACK.axial_stiffness)
    time = dt * np.arange(round(30.0 / dt) + 1)
    record = solver(cable=cable, n_elements=n_elements).simulate(
        amplitude * np.sin(omega * time), dt, 300.0 + speed * time
    )
    assert record.tension_min.min() >= 0.0
    assert np.isfinite(record.payload_displacement).all()
    assert 0.0 <= record.slack_fraction <= 1.0


@settings(max_examples=15, deadline=None, derandomize=True)
@given(shift=st.floats(-50.0, 50.0), scale=st.floats(0.01, 3.0))
def test_where_the_sheave_is_does_not_matter_and_a_dragless_cable_is_linear(shift, scale):
    cable = dataclasses.replace(CASE.cable, tangential_drag_coefficient=0.0)
    payload = dataclasses.replace(CASE.payload, drag_area=0.0)
    one = solver(cable=cable, payload=payload)
    base = one.simulate(heave(200), DT)
    other = one.simulate(shift + scale * heave(200), DT)
    moved = other.payload_displacement - shift
    assert moved == pytest.approx(scale * base.payload_displacement, abs=1e-9 * (1.0 + abs(shift)))
    static = base.sheave_tension[0]
    assert other.sheave_tension - static == pytest.approx(
        scale * (base.sheave_tension - static), abs=1e-6 * static
    )


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    st.lists(st.tuples(st.floats(0.0, 40.0), st.floats(-3.0, 3.0)), min_size=1, max_size=6),
    st.floats(0.1, 60.0),
)
def test_paid_out_is_the_integral_of_its_speed(knots, end):
    knots = sorted(knots, key=lambda knot: knot[0])
    times, speeds = tuple(t for t, _ in knots), tuple(v for _, v in knots)
    fine = np.linspace(0.0, end, 20_001)
    if len(set(times)) == len(times):
        rough = np.trapezoid(np.interp(fine, times, speeds), fine)
        assert paid_out(fine, times, speeds)[-1] == pytest.approx(rough, abs=1e-2)
    whole = paid_out(fine, times, speeds)
    assert whole[0] == 0.0
    assert np.abs(np.diff(whole)).max() <= 3.0 * end / 20_000 + 1e-9


def test_a_jump_of_the_pay_out_speed_is_two_knots_at_one_instant():
    out = paid_out(np.array([0.0, 10.0, 20.0]), (0.0, 10.0, 10.0), (1.0, 1.0, -2.0))
    assert out == pytest.approx([0.0, 10.0, -10.0])


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"dt": 2.0}, "Lowering.dt must be at most the duration"),
        ({"pay_out_time": (0.0, 1.0)}, "pay_out_speed must be 2 numbers"),
        ({"pay_out_time": (1.0, 0.0), "pay_out_speed": (0.0, 0.0)}, "pay_out_time must be in order"),
        ({"heave_amplitude": -1.0}, "heave_amplitude must be a number that is not negative"),
    ],
)
def test_impossible_operations_are_refused_with_a_sentence(changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        example_five(duration=1.0, **changes)


def test_recovery_of_more_cable_than_there_is_is_refused():
    with pytest.raises(ValueError, match="recover less"):
        example_five(duration=100.0, pay_out_speed=(-1.0,)).outcome()


def test_a_motion_file_moves_the_sheave_and_pays_out(tmp_path):
    time = np.arange(0.0, 21.0)
    rows = "\n".join(f"{t},{math.sin(0.5 * t)},{2.0 * t}" for t in time)
    motion = tmp_path / "motion.csv"
    motion.write_text(f"time,heave,payout\n{rows}\n")
    case = example_five(duration=20.0, motion_file=str(motion), pay_out_speed=(1.0,))
    record = case.record()
    assert record.length[-1] == pytest.approx(50.0 + 3.0 * 20.0)
    assert record.sheave_heave[200] == pytest.approx(math.sin(5.0))
    assert "resonant_length" not in {quantity.name for quantity in case.outcome().quantities}


def test_outcomes_are_numbers_and_tables_of_one_length():
    lowering = dataclasses.replace(example_five(duration=20.0), heave_omega=1.0)
    sweep = dataclasses.replace(thesis_sphere_in_water(), n_omegas=3, n_settling=5, n_measured=2)
    for outcome in (lowering.outcome(), sweep.outcome()):
        assert all(math.isfinite(quantity.value) for quantity in outcome.quantities)
        for columns in outcome.tables.values():
            assert len({len(values) for values in columns.values()}) == 1


def test_resonant_length_resonates():
    for omega in (0.4, 0.9, 2.0):
        length = float(resonant_length(omega, CASE.cable, CASE.payload))
        assert natural_omegas(CASE.cable, CASE.payload, length, 1)[0] == pytest.approx(omega, rel=1e-9)


def test_resonant_length_without_the_cables_mass_is_the_thesiss_estimate():
    spring = Cable(mass_per_length=0.0, axial_stiffness=1e7, submerged_weight=0.0, diameter=0.04)
    payload = Payload(mass=5000.0, added_mass=8000.0, submerged_weight=1e4)
    assert resonant_length(0.5, spring, payload) == pytest.approx(1e7 / (0.25 * 13_000.0), rel=1e-12)


def test_the_thesiss_scheme_wants_four_elements():
    with pytest.raises(ValueError, match="n_elements must be at least 4"):
        ThesisScheme(cable=CASE.cable, payload=CASE.payload, printed=True, n_elements=3)


def test_at_constant_length_print_and_material_are_one():
    motion, length = heave(400), np.full(401, 300.0)
    one, other = (
        ThesisScheme(cable=CASE.cable, payload=CASE.payload, printed=printed).simulate(motion, DT, length)
        for printed in (True, False)
    )
    assert np.array_equal(one, other)


def test_a_lowering_is_a_value():
    assert isinstance(CASE, Lowering)
    assert example_five(duration=1.0) == CASE
    assert hash(example_five(duration=1.0)) == hash(CASE)


def test_a_march_is_far_faster_than_real_time():
    one, motion = solver(), heave(20_000)
    one.simulate(motion[:10], DT)
    start = clock.perf_counter()
    one.simulate(motion, DT)
    ratio = 1000.0 / (clock.perf_counter() - start)
    print(f"20 elements, 0.05 s: {ratio:.0f} simulated seconds per second")
    assert ratio > 1000.0
