"""The sagged span: what it refuses, what it keeps, and that a step is a step of the march."""

from __future__ import annotations

import copy
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.cases.sagged_span import moustafa_span
from heave_env.cable.catenary import hanging_span, length_of_force, length_of_sag
from heave_env.cable.convergence import ConvergenceError
from heave_env.cable.sagged_span import SaggedSpanSolver
from heave_env.parameters import Cable, Current

WIRE = Cable(mass_per_length=0.61, axial_stiffness=7.85e6, submerged_weight=5.19, diameter=0.01)
ROPE = replace(WIRE, axial_stiffness=5e3, axial_damping=50.0, tension_only=True)
FEW = settings(max_examples=15, deadline=None, derandomize=True)


@pytest.fixture(scope="module")
def span() -> SaggedSpanSolver:
    return SaggedSpanSolver(cable=ROPE, length=11.0, span=10.8, height=1.0, n_elements=16)


def pulled(n_steps: int = 60, dt: float = 0.02, size: tuple[float, float, float] = (0.2, 0.1, 0.3)):
    time = dt * np.arange(n_steps + 1)
    return np.outer(np.sin(1.5 * time) ** 2, size)


# What it refuses -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"length": 10.0}, r"impossible geometry: a cable of 10 m cannot span 10.792 m.*EA = 7.85e\+06 N"),
        ({"length": -1.0}, "length must be a positive number, got -1.0"),
        ({"span": 0.0}, "span must be a positive number, got 0.0"),
        ({"height": -2.0}, "height must be a number that is not negative, got -2.0"),
        ({"n_elements": 7}, "n_elements must be even.*got 7"),
        ({"n_elements": 2}, "n_elements must be an integer of at least 4, got 2"),
        ({"strain": "green"}, "strain must be one of engineering, moustafa, got 'green'"),
        ({"lower_depth": math.nan}, "lower_depth must be a finite number"),
        ({"cable": replace(WIRE, mass_per_length=0.0)}, "mass_per_length must be a positive number"),
        ({"cable": replace(WIRE, submerged_weight=0.0)}, "a weightless cable of 10.9774 m has no shape"),
        (
            {"cable": replace(WIRE, breaking_strength=50.0)},
            "hangs between its supports at 91.* N, but it breaks at 50 N; give a greater",
        ),
        (
            {"cable": replace(WIRE, breaking_strength=1e4), "length": 10.7},
            "impossible geometry.*it breaks at 10000 N",
        ),
    ],
)
def test_an_impossible_span_is_refused_with_a_sentence(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        SaggedSpanSolver(**{"cable": WIRE, "length": 10.9774, "span": 10.792} | change)


def test_a_stretchy_cable_shorter_than_its_span_is_possible():
    found = hanging_span(replace(WIRE, axial_stiffness=2e4), 10.0, 10.792, 0.0)
    assert found.horizontal_force == pytest.approx(2e4 * 0.0792, rel=0.01)


def test_nearly_infinite_stiffness_is_no_trouble_where_the_cable_is_long_enough():
    found = hanging_span(replace(WIRE, axial_stiffness=1e30), 10.9774, 10.792, 0.0)
    assert found.horizontal_force == pytest.approx(87.45, rel=1e-3)
    with pytest.raises(ValueError, match=r"impossible geometry.*EA = 1e\+30 N"):
        hanging_span(replace(WIRE, axial_stiffness=1e30), 10.7919, 10.792, 0.0)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"dt": 0.01}, "the motion of at least one support must be given"),
        ({"upper": np.zeros(5), "dt": 0.0}, "dt must be a positive number"),
        ({"upper": np.zeros((5, 2)), "dt": 0.01}, r"upper must have the shape \(5, 3\) or \(5,\)"),
        ({"upper": np.zeros(5), "lower": np.zeros(4), "dt": 0.01}, r"must have the shape \(4, 3\) or"),
        ({"upper": np.full(5, np.nan), "dt": 0.01}, "upper must hold finite numbers"),
        ({"upper": np.full(5, 0.1), "dt": 0.01}, "upper must begin where the state's support is"),
        ({"upper": np.zeros(5), "load": np.zeros(4), "dt": 0.01}, r"load must have the shape \(5, 3\)"),
    ],
)
def test_an_impossible_march_is_refused_with_a_sentence(span, arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        span.simulate(**arguments)


def test_a_state_of_another_grid_is_refused(span):
    with pytest.raises(ValueError, match="state must be of a span of 16 elements, got one of 8"):
        span.simulate(upper=np.zeros(3), dt=0.01, state=replace(span, n_elements=8).rest())


def test_lengths_that_cannot_be_found_are_refused():
    with pytest.raises(ValueError, match="sag must be a positive number"):
        length_of_sag(WIRE, 10.0, 0.0, -1.0)
    with pytest.raises(ValueError, match="a weightless cable does not sag"):
        length_of_sag(replace(WIRE, submerged_weight=0.0), 10.0, 0.0, 1.0)
    with pytest.raises(ValueError, match="sag must be below"):
        length_of_sag(WIRE, 10.0, 0.0, 1e6)
    with pytest.raises(ValueError, match="horizontal_force must be a positive number"):
        length_of_force(WIRE, 10.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="horizontal_force must be at least"):
        length_of_force(WIRE, 10.0, 0.0, 1e-3)


def test_a_weightless_rope_is_a_straight_spring():
    rope = replace(WIRE, submerged_weight=0.0, axial_stiffness=1e4)
    length = length_of_force(rope, 3.0, 4.0, 300.0)
    assert length == pytest.approx(5.0 / 1.05)
    assert hanging_span(rope, length, 3.0, 4.0).horizontal_force == pytest.approx(300.0)
    with pytest.raises(ValueError, match="a weightless cable of 5 m has no shape"):
        hanging_span(rope, 5.0, 3.0, 4.0)


def test_a_case_says_what_is_wrong_with_its_motion():
    with pytest.raises(ValueError, match="upper_amplitude must be three finite numbers"):
        replace(moustafa_span(), upper_amplitude=(0.1,))
    with pytest.raises(ValueError, match="periods must be at least the growing and steady ones"):
        replace(moustafa_span(), periods=4.0)


# What it keeps -------------------------------------------------------------------------------------


@FEW
@given(
    slack=st.floats(-0.02, 1.0),
    steepness=st.floats(0.0, 3.0),
    weight=st.sampled_from([-3.0, 1e-6, 0.5, 200.0]),
    stiffness=st.sampled_from([3e3, 1e6, 1e12]),
)
def test_any_catenary_ends_at_its_supports(slack, steepness, weight, stiffness):
    cable = replace(WIRE, submerged_weight=weight, axial_stiffness=stiffness, diameter=1.0)
    height = 10.0 * steepness
    length = math.hypot(10.0, height) * (1.0 + (slack if stiffness < 1e10 else abs(slack)))
    found = hanging_span(cable, length, 10.0, height)
    ends = found.position(np.array([0.0, length]))
    assert ends[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert ends[1] == pytest.approx([10.0, 0.0, height], abs=1e-8 * length)


@FEW
@given(sag=st.floats(0.01, 30.0), height=st.floats(0.0, 20.0))
def test_a_length_found_from_sag_or_force_gives_them_back(sag, height):
    found = hanging_span(WIRE, length_of_sag(WIRE, 12.0, height, sag), 12.0, height)
    assert found.sag == pytest.approx(sag, rel=1e-6)
    again = length_of_force(WIRE, 12.0, height, found.horizontal_force)
    assert again == pytest.approx(found.length, rel=1e-8)


@FEW
@given(x=st.floats(-0.5, 0.3), y=st.floats(-0.5, 0.5), z=st.floats(-0.5, 0.5), dt=st.floats(0.003, 0.05))
def test_whatever_the_supports_do_tension_is_a_number_and_never_negative(span, x, y, z, dt):
    record = span.simulate(upper=pulled(60, dt, (x, y, z)), lower=pulled(60, dt, (-y, z, x)), dt=dt)
    for values in (record.tension_min, record.lower_tension, record.upper_tension):
        assert np.all(values >= 0.0)
    assert np.all(np.isfinite(record.state.displacement))
    assert np.all((record.slack_fraction >= 0.0) & (record.slack_fraction <= 1.0))


@FEW
@given(x=st.floats(-0.3, 0.3), y=st.floats(0.05, 0.5), z=st.floats(-0.3, 0.3))
def test_a_mirrored_motion_gives_the_mirrored_answer(span, x, y, z):
    one = span.simulate(upper=pulled(size=(x, y, z)), dt=0.02)
    other = span.simulate(upper=pulled(size=(x, -y, z)), dt=0.02)
    mirror = np.array([1.0, -1.0, 1.0])
    assert other.midpoint_displacement == pytest.approx(one.midpoint_displacement * mirror, abs=1e-9)
    assert other.upper_tension == pytest.approx(one.upper_tension, abs=1e-6)


@FEW
@given(x=st.floats(0.02, 0.3), z=st.floats(-0.2, 0.2))
def test_a_level_span_does_not_know_left_from_right(x, z):
    level = SaggedSpanSolver(cable=ROPE, length=11.0, span=10.8, n_elements=12)
    right = level.simulate(upper=pulled(size=(x, 0.0, z)), dt=0.02)
    left = level.simulate(lower=pulled(size=(-x, 0.0, z)), dt=0.02)
    assert left.lower_tension == pytest.approx(right.upper_tension, abs=1e-6)
    mirror = np.array([-1.0, 1.0, 1.0])
    assert left.midpoint_displacement == pytest.approx(right.midpoint_displacement * mirror, abs=1e-9)


@FEW
@given(
    kick=st.floats(0.1, 3.0), tension_only=st.booleans(), strain=st.sampled_from(["engineering", "moustafa"])
)
def test_energy_stays_without_drag_and_damping(kick, tension_only, strain):
    cable = replace(
        ROPE,
        axial_damping=0.0,
        normal_drag_coefficient=0.0,
        normal_added_mass_coefficient=0.0,
        tension_only=tension_only,
    )
    solver = SaggedSpanSolver(cable=cable, length=11.0, span=10.8, n_elements=12, strain=strain)
    state = solver.rest()
    velocity = np.zeros_like(state.velocity)
    velocity[1:-1, 2] = kick * np.sin(np.linspace(0.0, np.pi, 13))[1:-1]
    state = replace(state, velocity=velocity)
    after = solver.simulate(upper=np.zeros(301), dt=0.02, state=state).state
    brought = solver.energy(state) - solver.energy(solver.rest())
    assert solver.energy(after) == pytest.approx(solver.energy(state), abs=1e-9 * brought)


def test_a_span_moved_as_a_whole_in_a_vacuum_takes_its_weight_along():
    # Both supports rise alike and slowly stop: shape and tension are those of rest.
    solver = SaggedSpanSolver(cable=replace(WIRE.in_air(), axial_damping=1e4), length=11.0, span=10.8)
    rise = np.outer(np.sin(0.5 * np.pi * np.minimum(np.arange(2001) / 1900.0, 1.0)) ** 4, [0.3, 0.2, 2.0])
    record = solver.simulate(rise, rise, dt=0.02)
    assert record.state.displacement[8] == pytest.approx([0.3, 0.2, 2.0], abs=2e-3)
    assert record.upper_tension[-1] == pytest.approx(record.upper_tension[0], rel=2e-3)


def test_a_load_upwards_of_the_weight_lifts_it():
    record = SaggedSpanSolver(cable=WIRE, length=11.0, span=10.8).simulate(
        upper=np.zeros(51), dt=0.02, load=np.outer(np.linspace(0.0, 1.0, 51), [0.0, 0.0, 2.0 * 5.19])
    )
    assert record.midpoint_displacement[-1, 2] > 0.05


def test_a_current_acts_below_the_depth_where_it_flows():
    deep = Current(depth=(0.0, 10.0, 10.1), speed=(0.0, 0.0, 1.0), direction=(0.0, 0.0, 1.57))
    at_surface = SaggedSpanSolver(cable=ROPE, length=11.0, span=10.8, current=deep)
    still = at_surface.simulate(upper=np.zeros(51), dt=0.02)
    flowing = replace(at_surface, lower_depth=20.0).simulate(upper=np.zeros(51), dt=0.02)
    assert abs(still.midpoint_displacement[-1, 1]) < 1e-12
    assert flowing.midpoint_displacement[-1, 1] > 0.1


# States and steps ----------------------------------------------------------------------------------


def test_steps_taken_singly_are_the_march(span):
    motion, lower = pulled(), -0.5 * pulled()
    record = span.simulate(lower, motion, dt=0.02, shape_every=10)
    state = span.rest()
    for k in range(1, len(motion)):
        state = span.step(state, motion[k], 0.02, lower=lower[k])
        assert span.top_tension(state) == record.upper_tension[k]
        assert np.array_equal(span.payload_motion(state)[0], record.midpoint_displacement[k])
    assert np.array_equal(state.displacement, record.state.displacement)
    assert np.array_equal(span.position(state), record.shapes[-1])
    assert len(record.shapes) == len(record.shape_time) == 7


def test_a_march_goes_on_from_its_last_state(span):
    motion = pulled()
    whole = span.simulate(upper=motion, dt=0.02)
    first = span.simulate(upper=motion[:31], dt=0.02)
    second = span.simulate(upper=motion[30:], dt=0.02, state=first.state)
    assert np.array_equal(second.state.displacement, whole.state.displacement)
    assert second.upper_tension[-1] == whole.upper_tension[-1]
    assert second.time[-1] == pytest.approx(whole.time[-1])


def test_states_copy_compare_and_stay_as_they_are(span):
    state = span.simulate(upper=pulled(), dt=0.02).state
    same = copy.deepcopy(state)
    assert state == same == pickle.loads(pickle.dumps(state))
    assert state != span.rest() and state != "state"
    span.step(state, state.displacement[-1], 0.02)
    assert state == same


def test_modes_are_orthogonal_shapes_of_rising_frequency(span):
    omegas, shapes = span.modes(6)
    assert np.all(np.diff(omegas) >= 0.0) and omegas[0] > 0.0
    assert np.abs(shapes).max(axis=(1, 2)) == pytest.approx(1.0)
    assert np.all(shapes[:, [0, -1]] == 0.0)
    with pytest.raises(ValueError, match="n_modes must be from 1 to 45"):
        span.modes(46)


def test_a_violent_snap_is_solved_or_refused_but_never_nan():
    # A bare wire, undamped, thrown slack and jerked taut within one step after another.
    bare = SaggedSpanSolver(cable=replace(WIRE, tension_only=True), length=10.9, span=10.8, n_elements=20)
    jerks = np.where(np.arange(41) % 2 == 1, 0.3, 0.0)
    try:
        record = bare.simulate(upper=np.where(np.arange(41) == 0, 0.0, jerks), dt=0.05)
    except ConvergenceError as error:
        assert "does not settle" in str(error) and math.isfinite(error.residual)
    else:
        assert np.all(np.isfinite(record.upper_tension))
