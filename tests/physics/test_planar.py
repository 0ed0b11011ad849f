"""The planar cable's face: bad input, states, symmetry, robustness. Its numbers are held in validation."""

from __future__ import annotations

import dataclasses
import math
import pickle
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heave_env.cable.convergence import ConvergenceError
from heave_env.cable.planar import PlanarSolver
from heave_env.parameters import Cable, Current, Payload

CABLE = Cable(
    mass_per_length=5.0,
    axial_stiffness=1.0e7,
    submerged_weight=35.0,
    diameter=0.03,
    tangential_drag_coefficient=0.02,
)
PAYLOAD = Payload(
    mass=3_000.0,
    added_mass=2_000.0,
    submerged_weight=20_000.0,
    drag_area=3.0,
    lateral_added_mass=1_000.0,
    lateral_drag_area=2.0,
)
CURRENT = Current(depth=(0.0, 150.0), speed=(0.9, 0.3), direction=(0.0, 0.0))
SOLVER = PlanarSolver(cable=CABLE, payload=PAYLOAD, length=100.0, n_elements=10, current=CURRENT)
SNAPPING = dataclasses.replace(CABLE, tension_only=True, axial_damping=0.005 * CABLE.axial_stiffness)
DT = 0.05

few = settings(max_examples=12, deadline=None, derandomize=True)
amplitudes = st.floats(-3.0, 3.0)
omegas = st.floats(0.2, 2.0)


def swept(n_steps: int, sway: float, heave: float, omega: float) -> tuple[np.ndarray, np.ndarray]:
    """A boom tip that starts from rest and sways and heaves."""
    t = DT * np.arange(n_steps + 1)
    growth = np.minimum(t / 4.0, 1.0) ** 2
    return growth * sway * np.sin(omega * t), growth * heave * np.sin(1.3 * omega * t)


# Bad input ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"length": 0.0}, "PlanarSolver.length must be a positive number, got 0.0"),
        ({"n_elements": 0}, "PlanarSolver.n_elements must be an integer of at least 1, got 0"),
        ({"payload_drag": "tensor"}, "payload_drag must be one of components, vector, got 'tensor'"),
        (
            {"payload": dataclasses.replace(PAYLOAD, submerged_weight=-5.0)},
            "Payload.submerged_weight must be a positive number, got -5.0",
        ),
        (
            {"cable": dataclasses.replace(CABLE, submerged_weight=-300.0)},
            "the payload's weight of 20000 N must exceed the buoyancy of 100 m of a cable of -300 N/m",
        ),
    ],
)
def test_wrong_parameters_are_named(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        dataclasses.replace(SOLVER, **change)


@pytest.mark.parametrize(
    ("motion", "sentence"),
    [
        ((np.zeros(5), np.zeros(4), DT), "top_x and top_z must be equally long series"),
        ((np.full(5, np.nan), np.zeros(5), DT), "top_x and top_z must be finite"),
        ((np.zeros(5), np.zeros(5), 0.0), "dt must be a positive number, got 0.0"),
        ((np.zeros(5), np.zeros(5), DT, np.full(4, 100.0)), "one number for each of the 5 instants"),
        ((np.zeros(5), np.zeros(5), DT, np.linspace(100.0, -1.0, 5)), "length must be positive throughout"),
    ],
)
def test_a_wrong_motion_is_named(motion, sentence):
    with pytest.raises(ValueError, match=sentence):
        SOLVER.simulate(*motion)


def test_a_start_that_does_not_fit_the_motion_is_named():
    with pytest.raises(
        ValueError, match="start must have 10 elements and the motion's first length of 100 m"
    ):
        SOLVER.simulate(np.zeros(5), np.zeros(5), DT, np.full(5, 100.0), start=SOLVER.hanging(length=90.0))
    with pytest.raises(ValueError, match="length must be a positive number, got -3"):
        SOLVER.rest(length=-3.0)


def test_a_light_line_may_float_as_long_as_its_payload_does_not():
    floating = dataclasses.replace(CABLE, submerged_weight=-20.0)
    rest = dataclasses.replace(SOLVER, cable=floating).rest()
    assert rest.tension[0] > rest.tension[-1] > 0.0


def test_a_current_that_blows_the_cable_out_is_an_error_that_says_so():
    blown = dataclasses.replace(SOLVER, current=Current.uniform(150.0))
    with pytest.raises(ConvergenceError, match="blows the cable out") as caught:
        blown.rest()
    assert math.isfinite(caught.value.residual)


def test_the_component_across_the_plane_is_not_felt():
    beside = dataclasses.replace(SOLVER, current=Current.uniform(1.0, 0.5 * math.pi))
    assert np.abs(beside.rest().position[:, 0]).max() < 1e-12


# States ------------------------------------------------------------------------------------------


def test_steps_taken_singly_are_the_march():
    x, z = swept(60, 2.0, 1.0, 0.8)
    length = 100.0 + np.where(np.arange(61) > 30, 0.04 * (np.arange(61) - 30), 0.0)
    record = SOLVER.simulate(x, z, DT, length)
    state = SOLVER.rest((x[0], z[0]))
    for k in range(1, 61):
        state = SOLVER.step(state, (x[k], z[k], length[k]), DT)
        position, velocity = SOLVER.payload_motion(state)
        assert tuple(position) == (record.payload_x[k], record.payload_z[k])
        assert tuple(velocity) == (record.payload_velocity_x[k], record.payload_velocity_z[k])
        assert SOLVER.top_tension(state) == record.top_tension[k]
    assert state.length == record.final.length
    assert np.array_equal(state.position, record.final.position)


def test_a_march_goes_on_from_where_it_ended():
    x, z = swept(100, 1.0, 1.0, 0.9)
    factor = dataclasses.replace(CURRENT, time=(0.0, 3.0, 5.0), factor=(1.0, 0.2, 1.5))
    solver = dataclasses.replace(SOLVER, current=factor)
    whole = solver.simulate(x, z, DT)
    first = solver.simulate(x[:51], z[:51], DT)
    second = solver.simulate(x[50:], z[50:], DT, start=first.final)
    assert second.time[0] == pytest.approx(50 * DT)
    assert second.payload_x[-1] == pytest.approx(whole.payload_x[-1], abs=1e-9)


def test_a_state_copies_compares_and_pickles_and_steps_leave_it_alone():
    state = SOLVER.rest()
    twin = state.copy()
    assert twin == state and pickle.loads(pickle.dumps(state)) == state
    moved = SOLVER.step(state, (0.1, 0.0, 100.1), DT)
    assert state == twin and moved != state
    assert moved.time == DT and moved.length == 100.1


def test_rest_stays_at_rest_in_its_current():
    record = SOLVER.simulate(np.zeros(200), np.zeros(200), DT)
    assert np.ptp(record.payload_x) < 1e-9 and np.ptp(record.payload_z) < 1e-9
    assert record.top_tension == pytest.approx(SOLVER.top_tension(SOLVER.rest()), rel=1e-9)
    assert not record.slack.any()


def test_forces_balance_at_rest():
    # What the sheave holds is the weights and the drag of the whole, which the payload's part is known of.
    bare = dataclasses.replace(CABLE, normal_drag_coefficient=0.0, tangential_drag_coefficient=0.0)
    solver = dataclasses.replace(SOLVER, cable=bare, current=Current.uniform(0.8), n_elements=40)
    record = solver.simulate(np.zeros(1), np.zeros(1), DT)
    force_x, force_z = record.top_force
    assert force_x[0] == pytest.approx(
        PAYLOAD.lateral_drag_factor * 0.64, rel=1e-3
    )  # extrapolated to the top
    assert force_z[0] == pytest.approx(-(20_000.0 + 35.0 * 100.0), rel=1e-4)


def test_shapes_are_kept_when_asked_for():
    x, z = swept(40, 1.0, 0.0, 1.0)
    record = SOLVER.simulate(x, z, DT, shapes_every=10)
    assert record.shapes.shape == (5, 11, 2)
    assert record.shape_time == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])
    assert record.shapes[:, -1, 0] == pytest.approx(x[::10])
    assert SOLVER.simulate(x, z, DT).shapes.shape == (0, 11, 2)


# Invariants ----------------------------------------------------------------------------------------


@few
@given(sway=amplitudes, heave=amplitudes, omega=omegas)
def test_the_mirrored_operation_moves_in_the_mirror(sway, heave, omega):
    x, z = swept(200, sway, heave, omega)
    mirrored = dataclasses.replace(SOLVER, current=dataclasses.replace(CURRENT, speed=(-0.9, -0.3)))
    one, other = SOLVER.simulate(x, z, DT), mirrored.simulate(-x, z, DT)
    assert other.payload_x == pytest.approx(-one.payload_x, abs=1e-8)
    assert other.payload_z == pytest.approx(one.payload_z, abs=1e-8)
    assert other.top_angle == pytest.approx(-one.top_angle, abs=1e-8)


@few
@given(sway=amplitudes, heave=amplitudes, shift=st.floats(-500.0, 500.0))
def test_where_the_operation_takes_place_does_not_matter(sway, heave, shift):
    x, z = swept(150, sway, heave, 0.9)
    here, there = SOLVER.simulate(x, z, DT), SOLVER.simulate(x + shift, z, DT)
    assert there.payload_x - shift == pytest.approx(here.payload_x, abs=1e-7)


@few
@given(
    heave=st.floats(1.0, 8.0),
    sway=st.floats(0.0, 8.0),
    omega=st.floats(0.5, 3.0),
    n_elements=st.integers(1, 25),
    speed=st.floats(-1.5, 1.5),
)
def test_a_snapping_cable_never_pushes_and_never_fails(heave, sway, omega, n_elements, speed):
    solver = dataclasses.replace(
        SOLVER, cable=SNAPPING, n_elements=n_elements, current=Current.uniform(speed)
    )
    x, z = swept(400, sway, heave, omega)
    record = solver.simulate(x, z, DT)
    assert record.least_tension.min() >= 0.0
    for series in (record.payload_x, record.payload_z, record.top_tension, record.top_angle):
        assert np.all(np.isfinite(series))
    # No farther from the sheave than the cable at its tautest; tensions are means over a step, hence 1 m.
    reach = 100.0 * (1.0 + record.largest_tension.max() / CABLE.axial_stiffness) + 1.0
    farthest = np.hypot(record.payload_x - x, record.payload_z - z).max()
    assert farthest <= reach


@few
@given(speed=st.floats(-3.0, 3.0), weight=st.floats(50.0, 5e4), n_elements=st.integers(1, 60))
def test_rest_is_found_in_any_current_that_a_cable_survives(speed, weight, n_elements):
    solver = dataclasses.replace(
        SOLVER,
        payload=dataclasses.replace(PAYLOAD, submerged_weight=weight),
        current=Current.uniform(speed),
        n_elements=n_elements,
    )
    rest = solver.rest((3.0, -1.0), 80.0)
    assert tuple(rest.position[-1]) == (3.0, -1.0)
    assert rest.tension.min() > 0.0
    # It stays: no force is left over.
    moved = solver.step(rest, (3.0, -1.0, 80.0), 0.1)
    assert moved.position == pytest.approx(rest.position, abs=1e-7)


@few
@given(first=st.floats(-4.0, 4.0), second=st.floats(-4.0, 4.0))
def test_pay_out_may_jump_and_turn(first, second):
    t = DT * np.arange(201)
    length = 100.0 + np.where(t < 5.0, first * t, first * 5.0 + second * (t - 5.0))
    solver = dataclasses.replace(SOLVER, cable=SNAPPING)
    record = solver.simulate(0.0 * t, 0.0 * t, DT, length)
    below = np.hypot(record.payload_x, record.payload_z)
    assert np.all(below < length * 1.02 + 2.0)
    assert record.least_tension.min() >= 0.0


def test_an_abrupt_jerk_of_the_sheave_is_survived():
    x, z = np.zeros(101), np.zeros(101)
    x[20:], z[20:] = 5.0, 3.0
    record = dataclasses.replace(SOLVER, cable=SNAPPING).simulate(x, z, DT)
    assert np.all(np.isfinite(record.top_tension))
    assert record.payload_x[-1] > record.payload_x[0]


def test_a_march_runs_far_faster_than_real_time():
    solver = dataclasses.replace(SOLVER, n_elements=40)
    x, z = swept(4000, 1.0, 1.0, 0.9)
    solver.simulate(x[:3], z[:3], DT)  # compiles
    begin = time.perf_counter()
    solver.simulate(x, z, DT)
    speed = 4000 * DT / (time.perf_counter() - begin)
    print(f"40 elements, steps of {DT} s: {speed:.0f} simulated seconds per second")
    assert speed > 100.0  # measured above 2000, on a busy core too


# Ropes that harden and relax -------------------------------------------------------------------------

ROPE = dataclasses.replace(
    SNAPPING,
    axial_stiffness=2.0e6,
    axial_damping=1.0e4,
    quadratic_hardening=15.0,
    cubic_hardening=200.0,
    relaxing_stiffness=2.0e6,
    relaxation_time=3.0,
)


def test_a_rope_carries_what_its_branches_hold_from_march_to_march():
    solver = dataclasses.replace(SOLVER, cable=ROPE)
    x, z = swept(120, 2.0, 1.5, 1.1)
    length = 100.0 + np.where(np.arange(121) > 40, 0.03 * (np.arange(121) - 40), 0.0)
    whole = solver.simulate(x, z, DT, length)
    first = solver.simulate(x[:61], z[:61], DT, length[:61])
    second = solver.simulate(x[60:], z[60:], DT, length[60:], start=first.final)
    assert first.final.branch_strain.shape == (10,) and np.abs(first.final.branch_strain).max() > 1e-4
    assert np.array_equal(second.final.branch_strain, whole.final.branch_strain)
    assert second.final.position == pytest.approx(whole.final.position, abs=1e-9)
    # Forgotten, it would tell.
    forgetful = dataclasses.replace(first.final, branch_strain=np.zeros(10))
    third = solver.simulate(x[60:], z[60:], DT, length[60:], start=forgetful)
    assert abs(third.payload_z[-1] - whole.payload_z[-1]) > 1e-3
    assert forgetful != first.final and first.final.copy() == first.final
    assert pickle.loads(pickle.dumps(first.final)) == first.final
    stepped = solver.rest((x[0], z[0]), length[0])
    for k in range(1, 61):
        stepped = solver.step(stepped, (x[k], z[k], length[k]), DT)
    assert np.array_equal(stepped.branch_strain, first.final.branch_strain)


def test_a_rope_rests_in_its_current_and_a_hookean_cable_holds_nothing():
    solver = dataclasses.replace(SOLVER, cable=ROPE)
    record = solver.simulate(np.zeros(100), np.zeros(100), DT)
    assert np.ptp(record.payload_x) < 1e-8 and np.ptp(record.payload_z) < 1e-8
    assert np.abs(record.final.branch_strain).max() < 1e-9
    assert len(SOLVER.simulate(np.zeros(3), np.zeros(3), DT).final.branch_strain) == 0


@few
@given(
    heave=st.floats(1.0, 8.0),
    sway=st.floats(0.0, 8.0),
    omega=st.floats(0.5, 3.0),
    n_elements=st.integers(1, 25),
    relaxation_time=st.floats(0.05, 100.0),
)
def test_a_snapping_rope_never_pushes_and_never_fails(heave, sway, omega, n_elements, relaxation_time):
    rope = dataclasses.replace(ROPE, relaxation_time=relaxation_time)
    solver = dataclasses.replace(SOLVER, cable=rope, n_elements=n_elements)
    record = solver.simulate(*swept(400, sway, heave, omega), DT)
    assert record.least_tension.min() >= 0.0
    for series in (record.payload_x, record.payload_z, record.top_tension, record.final.branch_strain):
        assert np.all(np.isfinite(series))
