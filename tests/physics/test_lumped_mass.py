"""The 3-D line: its invariants, its states, what it refuses and what it survives."""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heave_env.cable.constitutive import static_strain
from heave_env.cable.convergence import ConvergenceError
from heave_env.cable.lumped_mass import LineState, LumpedMassSolver
from heave_env.parameters import GRAVITY, Attachment, Cable, Current, Line, Payload, Section

CABLE = Cable(
    mass_per_length=5.4,
    axial_stiffness=1.56e7,
    submerged_weight=35.5,
    diameter=0.047,
    tangential_drag_coefficient=0.01,
)
LIMP = dataclasses.replace(CABLE, tension_only=True, axial_damping=5e-3 * CABLE.axial_stiffness)
PAYLOAD = Payload(mass=3000.0, added_mass=3000.0, submerged_weight=25_860.0, drag_area=0.75)
CURRENT = Current(depth=(0.0, 150.0, 350.0), speed=(0.6, 0.4, 0.2), direction=(0.0, 0.4, 1.0))

few = settings(max_examples=12, deadline=None, derandomize=True)


def hanging(n_segments: int = 12, **options: object) -> LumpedMassSolver:
    return LumpedMassSolver(
        **{"line": Line.uniform(CABLE, 300.0), "n_segments": n_segments, "payload": PAYLOAD, **options}
    )


def circling(dt: float, seconds: float = 10.0) -> np.ndarray:
    time = dt * np.arange(round(seconds / dt) + 1)
    return np.stack([np.sin(time) ** 2, 0.5 * np.sin(time) ** 3, -0.5 * np.sin(time) ** 2], axis=1)


# Invariants.


@few
@given(
    across=st.floats(0.0, 0.95),
    mass=st.floats(1.0, 500.0),
    n_segments=st.integers(1, 12),
    dt=st.floats(0.005, 0.05),
)
def test_energy_is_kept_without_drag_through_slack_and_snap(across, mass, n_segments, dt):
    cable = dataclasses.replace(CABLE.in_air(), tension_only=True)
    payload = Payload(mass=mass, submerged_weight=mass * GRAVITY)
    solver = LumpedMassSolver(
        line=Line.uniform(cable, 30.0), n_segments=n_segments, payload=payload, upper="fixed"
    )
    arms = solver.node_arc_lengths[::-1]
    start = solver.placed(np.stack([across * arms, 0.1 * arms, -0.3 * arms], axis=1))
    record = solver.simulate(dt=dt, n_steps=150, start=start)
    # Newton stops at 1e-9 of a segment; over 150 steps that is far below 1e-7 of the energy.
    assert solver.energy(record.end) == pytest.approx(solver.energy(start), rel=1e-7)
    assert record.least_tension.min() >= 0.0


@few
@given(angle=st.floats(-math.pi, math.pi), body_drag=st.sampled_from(["components", "vector"]))
def test_turning_everything_about_the_vertical_turns_the_answer(angle, body_drag):
    turn = np.array(
        [[math.cos(angle), -math.sin(angle), 0.0], [math.sin(angle), math.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
    turned_current = dataclasses.replace(CURRENT, direction=tuple(d + angle for d in CURRENT.direction))
    motion = circling(0.05)
    record = hanging(current=CURRENT, body_drag=body_drag).simulate(motion, dt=0.05)
    turned = hanging(current=turned_current, body_drag=body_drag).simulate(motion @ turn.T, dt=0.05)
    assert np.abs(turned.positions - record.positions @ turn.T).max() < 1e-7
    assert turned.top_tension == pytest.approx(record.top_tension, rel=1e-7)


@few
@given(heave=st.floats(0.5, 5.0), period=st.floats(4.0, 10.0), weight=st.floats(200.0, 20_000.0))
def test_tension_is_never_negative_with_slack_on(heave, period, weight):
    payload = dataclasses.replace(PAYLOAD, submerged_weight=weight)
    solver = LumpedMassSolver(line=Line.uniform(LIMP, 300.0), n_segments=12, payload=payload, current=CURRENT)
    time = 0.05 * np.arange(401)
    top = np.stack([0.0 * time, 0.0 * time, heave * (1.0 - np.cos(2.0 * math.pi * time / period))], axis=1)
    record = solver.simulate(top, dt=0.05)
    assert record.segment_tensions.min() >= 0.0 and record.least_tension.min() >= 0.0
    assert np.all(np.isfinite(record.positions))
    # No segment is longer than its tension allows.
    stretched = np.linalg.norm(np.diff(record.end.positions, axis=0), axis=1)
    assert stretched.max() < 25.0 * 1.1


@few
@given(speed=st.floats(0.0, 1.5), depth=st.floats(50.0, 400.0), direction=st.floats(-3.0, 3.0))
def test_the_static_shape_and_the_march_hardly_know_the_mesh(speed, depth, direction):
    current = Current(depth=(0.0, depth), speed=(speed, 0.5 * speed), direction=(0.0, direction))
    coarse, fine = (hanging(n, current=current).rest() for n in (15, 60))
    # Second order: some 4/15² of what bends the line; a current that turns round leaves little at its end.
    aside = float(np.linalg.norm(fine.positions[:, :2], axis=1).max())
    assert np.abs(coarse.positions[0] - fine.positions[0]).max() < 0.02 * aside + 1e-3
    assert hanging().top_tension(coarse) == pytest.approx(hanging().top_tension(fine), rel=2e-3)


@few
@given(change=st.floats(-80.0, 200.0), n_segments=st.integers(8, 20))
def test_splits_and_merges_keep_material(change, n_segments):
    solver = hanging(n_segments)
    length = 300.0 + change * np.sin(0.5 * math.pi * np.linspace(0.0, 1.0, 401)) ** 2
    record = solver.simulate((0.0, 0.0, 0.0), dt=0.1, length=length)
    assert record.end.length == pytest.approx(300.0 + change, rel=1e-12)
    assert record.length == pytest.approx(length)
    inner = record.end.segment_lengths[:-1]
    assert inner == pytest.approx(solver.nominal_length, rel=1e-12) or record.n_segments[-1] < n_segments
    assert 0.4 <= record.end.segment_lengths[-1] / solver.nominal_length <= 1.5


# States and marches.


def test_a_state_copies_and_compares():
    solver = hanging(current=CURRENT)
    state = solver.rest()
    twin = copy.deepcopy(state)
    assert twin == state and solver.rest() == state
    moved = solver.step(state, (0.1, 0.0, 0.0), 0.05)
    assert moved != state and twin == state
    assert state != "a state"


def test_steps_taken_singly_are_the_march():
    solver = hanging(current=dataclasses.replace(CURRENT, time=(0.0, 5.0), factor=(1.0, 1.3)))
    motion, length = circling(0.05, 3.0), 300.0 + 8.0 * np.sin(np.linspace(0.0, 3.0, 61)) ** 2
    record = solver.simulate(motion, dt=0.05, length=length)
    state = solver.rest(motion[0])
    for k in range(1, len(motion)):
        state = solver.step(state, motion[k], 0.05, length=length[k])
        position, velocity = solver.payload_motion(state)
        assert position == pytest.approx(record.payload_position[k], abs=1e-9)
        assert velocity == pytest.approx(record.payload_velocity[k], abs=1e-8)
        assert solver.top_tension(state) == pytest.approx(record.top_tension[k], rel=1e-7)
    assert state.time == pytest.approx(record.time[-1])


def test_a_march_goes_on_where_another_ended_and_records_as_seldom_as_asked():
    solver, motion = hanging(current=CURRENT), circling(0.05, 6.0)
    whole = solver.simulate(motion, dt=0.05)
    first = solver.simulate(motion[:61], dt=0.05)
    second = solver.simulate(motion[60:], dt=0.05, start=first.end)
    assert second.end.positions == pytest.approx(whole.end.positions, abs=1e-9)
    assert second.time[0] == pytest.approx(3.0)
    seldom = solver.simulate(motion, dt=0.05, every=7)
    assert seldom.end == whole.end
    assert np.array_equal(seldom.payload_position, whole.payload_position[::7])
    assert seldom.greatest_tension[1:].max() >= whole.greatest_tension[1 : 7 * (len(seldom.time) - 1)].max()
    assert solver.simulate(motion, dt=0.05, every=1000).time.shape == (1,)


def test_still_water_and_air_hang_straight_with_their_whole_weight():
    for cable, payload in ((CABLE, PAYLOAD), (CABLE.in_air(), PAYLOAD.in_air())):
        solver = LumpedMassSolver(line=Line.uniform(cable, 300.0), n_segments=7, payload=payload)
        state = solver.rest((5.0, -3.0, 2.0))
        assert solver.top_tension(state) == pytest.approx(
            payload.submerged_weight + 300.0 * cable.submerged_weight, rel=1e-9
        )
        assert np.linalg.norm(state.bottom_force) == pytest.approx(payload.submerged_weight, rel=1e-9)
        record = solver.simulate((5.0, -3.0, 2.0), dt=0.1, n_steps=200)
        assert np.abs(record.positions - state.positions).max() < 1e-8


# Lines of many kinds.


def test_forces_at_rest_balance_on_a_line_of_sections_with_bodies():
    rope = dataclasses.replace(CABLE, mass_per_length=2.0, submerged_weight=-4.0, axial_stiffness=2e6)
    float_ = Payload(mass=100.0, submerged_weight=-3000.0, drag_area=0.8, lateral_drag_area=1.5)
    line = Line(
        sections=(Section(cable=CABLE, length=100.0), Section(cable=rope, length=60.0)),
        attachments=(Attachment(arc_length=98.0, body=float_), Attachment(arc_length=30.0, body=PAYLOAD)),
    )
    solver = LumpedMassSolver(line=line, n_segments=40, lower="fixed", upper="fixed")
    state = solver.rest((80.0, 10.0, 0.0), (0.0, 0.0, -60.0))
    assert len(state.tensions) == 40
    up = state.top_force[2] - state.bottom_force[2]
    assert up == pytest.approx(line.submerged_weight, rel=1e-6)
    assert state.top_force[:2] == pytest.approx(state.bottom_force[:2], abs=1e-3)
    record = solver.simulate((80.0, 10.0, 0.0), bottom=(0.0, 0.0, -60.0), dt=0.05, n_steps=100)
    assert np.abs(record.positions - state.positions).max() < 1e-4


def test_drag_at_rest_in_a_current_is_what_the_ends_feel():
    # The payload hangs below its drag: tension at the unit has the drag of the unit as its horizontal part.
    current = Current.uniform(0.7, direction=0.9)
    for body_drag in ("components", "vector"):
        state = hanging(30, current=current, body_drag=body_drag).rest()
        drag = PAYLOAD.drag_factor * 0.7**2
        assert -state.bottom_force[:2] == pytest.approx(
            [drag * math.cos(0.9), drag * math.sin(0.9)], rel=1e-6
        )
        assert state.bottom_force[2] == pytest.approx(PAYLOAD.submerged_weight, rel=1e-9)
    by_axes = hanging(30, current=current, body_drag="axes").rest().bottom_force
    assert -by_axes[0] == pytest.approx(drag * math.cos(0.9) ** 2, rel=1e-6)


def test_a_line_standing_on_its_anchor_floats_up_and_a_free_one_falls():
    buoyant = dataclasses.replace(CABLE, submerged_weight=-20.0)
    standing = LumpedMassSolver(line=Line.uniform(buoyant, 200.0), lower="fixed", upper="free")
    state = standing.rest(None, (0.0, 0.0, -300.0))
    assert state.positions[-1, 2] == pytest.approx(-100.0, abs=0.1)
    free = LumpedMassSolver(line=Line.uniform(CABLE.in_air(), 50.0), n_segments=5, upper="free")
    arcs = free.node_arc_lengths
    start = free.placed(np.stack([arcs, 0.0 * arcs, 0.0 * arcs], axis=1))
    record = free.simulate(dt=0.1, n_steps=20, start=start)
    assert record.end.positions[:, 2] == pytest.approx(-0.5 * GRAVITY * 4.0, rel=1e-9)


@pytest.mark.parametrize("buoyancy", [500.0, 3000.0, 8000.0, 10_000.0])
def test_a_line_under_a_float_folds_and_is_not_held_upright_from_below(buoyancy):
    # Straight down it would be in balance too, compressed: a knife's edge. Folded, the float carries what
    # hangs from it, and the top the rest.
    float_ = Payload(mass=500.0, submerged_weight=-buoyancy, drag_area=1.0)
    solver = hanging(40, payload=float_)
    state = solver.rest()
    assert state.tensions.min() > 0.0
    assert solver.top_tension(state) == pytest.approx(300.0 * CABLE.submerged_weight - buoyancy, rel=1e-3)
    lowest = buoyancy / CABLE.submerged_weight
    assert state.positions[0, 2] - state.positions[:, 2].min() == pytest.approx(lowest, abs=7.5)


@pytest.mark.parametrize(
    "line, options, top, bottom",
    [
        (Line.uniform(CABLE, 300.0), {"lower": "fixed"}, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        (Line.uniform(CABLE, 300.0), {"lower": "fixed"}, (0.0, 0.0, 0.0), (0.0, 0.0, -200.0)),
        (Line.uniform(CABLE, 300.0), {"lower": "fixed"}, (0.0, 0.0, 0.0), (0.0, 0.0, -303.0)),
        (Line.uniform(CABLE, 300.0), {"lower": "fixed"}, (300.5, 0.0, 0.0), (0.0, 0.0, 0.0)),
        (
            Line.uniform(dataclasses.replace(CABLE, submerged_weight=0.0), 300.0),
            {"lower": "fixed", "current": Current.uniform(0.5, 1.5)},
            (290.0, 0.0, 0.0),
            (0.0, 0.0, 0.0),
        ),
        (
            Line.uniform(dataclasses.replace(CABLE, submerged_weight=1.0), 3000.0),
            {"current": Current.uniform(5.0), "n_segments": 100},
            (0.0, 0.0, 0.0),
            None,
        ),
        (Line.uniform(CABLE, 300.0), {"payload": PAYLOAD, "current": Current.uniform(10.0)}, (0, 0, 0), None),
    ],
    ids=["one point", "vertical slack", "vertical taut", "level taut", "neutral", "drag alone", "torrent"],
)
def test_hard_static_cases_settle_and_stay(line, options, top, bottom):
    solver = LumpedMassSolver(line=line, **options)
    state = solver.rest(top, bottom)
    assert np.all(np.isfinite(state.positions))
    record = solver.simulate(top, bottom=bottom, dt=0.02, n_steps=50)
    assert np.abs(record.positions - state.positions).max() < 1e-3


def test_a_jump_of_the_top_is_survived_and_steps_are_halved_for_it():
    solver = LumpedMassSolver(line=Line.uniform(LIMP, 300.0), n_segments=20, payload=PAYLOAD)
    top = np.zeros((41, 3))
    top[10:, 0] = 50.0
    record = solver.simulate(top, dt=0.05)
    assert np.all(np.isfinite(record.positions)) and record.least_tension.min() >= 0.0


def test_water_given_as_a_function_sees_nodes_and_instants():
    seen = []

    def water(positions: np.ndarray, time: float) -> np.ndarray:
        seen.append((positions.shape, time))
        return np.stack([0.4 + 0.0 * positions[:, 0], 0.0 * positions[:, 0], 0.0 * positions[:, 0]], axis=1)

    ours = hanging(water=water).simulate((0.0, 0.0, 0.0), dt=0.1, n_steps=5)
    table = hanging(current=Current.uniform(0.4)).simulate((0.0, 0.0, 0.0), dt=0.1, n_steps=5)
    assert ours.end.positions == pytest.approx(table.end.positions, abs=1e-9)
    assert seen[-1] == ((13, 3), pytest.approx(0.45))


# Refusals.


@pytest.mark.parametrize(
    "changes, sentence",
    [
        ({"n_segments": 0}, "n_segments must be an integer of at least 1, got 0"),
        ({"lower": "loose"}, "lower must be one of free, fixed, driven, got 'loose'"),
        ({"upper": "loose"}, "upper must be one of driven, fixed, free, got 'loose'"),
        ({"body_drag": "none"}, "body_drag must be one of components, axes, vector, got 'none'"),
        ({"lower": "fixed"}, "payload must be null unless the lower end is free"),
        ({"tolerance": 0.0}, "tolerance must be a positive number, got 0.0"),
    ],
)
def test_a_wrong_solver_is_refused_in_a_sentence(changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        hanging(**changes)


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ({"top": np.zeros((5, 3)), "dt": 0.0}, "dt must be a positive number"),
        ({"top": np.full((5, 3), np.nan), "dt": 0.1}, "top must hold finite numbers"),
        ({"top": np.zeros((5, 2)), "dt": 0.1}, "top must have the shape"),
        ({"top": (0.0, 0.0, 0.0), "dt": 0.1}, "must agree on a number of steps"),
        (
            {"top": np.zeros((5, 3)), "length": np.full(4, 300.0), "dt": 0.1},
            "must agree on a number of steps",
        ),
        ({"top": np.zeros((5, 3)), "length": np.full(5, 310.0), "dt": 0.1}, "length must begin with"),
        ({"length": np.linspace(300.0, 20.0, 5), "dt": 0.1}, "length must not fall below 50 m"),
        ({"top": np.zeros((5, 3)), "dt": 0.1, "every": 0}, "every must be at least 1"),
    ],
)
def test_a_wrong_march_is_refused_in_a_sentence(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        hanging().simulate(**arguments)


def test_ends_where_no_line_can_be_are_refused_in_a_sentence():
    solver = LumpedMassSolver(line=Line.uniform(CABLE, 300.0), lower="fixed")
    with pytest.raises(ValueError, match="ends are 500 m apart, more than the line of 300 m stretches"):
        solver.rest((500.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="bottom must be a position of three finite numbers"):
        solver.rest((100.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="needs a held end"):
        LumpedMassSolver(line=Line.uniform(CABLE, 300.0), upper="free").rest()
    with pytest.raises(ValueError, match="that end is fixed: make it driven"):
        hanging(upper="fixed").simulate(circling(0.1), dt=0.1)
    state = hanging().rest()
    with pytest.raises(ValueError, match="top begins 4 m from where the start state has that end"):
        hanging().simulate(np.full((3, 3), [0.0, 4.0, 0.0]), dt=0.1, start=state)
    with pytest.raises(ValueError, match="positions must be finite numbers of shape"):
        hanging().placed(np.zeros((3, 3)))
    with pytest.raises(ValueError, match="water must return finite velocities"):
        hanging(water=lambda r, t: np.zeros(3) if t > 0.0 else np.zeros_like(r)).simulate(
            (0.0, 0.0, 0.0), dt=0.1, n_steps=2
        )


def test_a_step_that_cannot_settle_says_so():
    # A tolerance below rounding can never be met.
    solver = dataclasses.replace(hanging(), tolerance=1e-30)
    with pytest.raises(ConvergenceError, match="did not settle even at a 256th") as caught:
        solver.simulate(circling(0.1, 0.3), dt=0.1)
    assert caught.value.residual > 0.0


def test_the_state_says_where_its_nodes_are():
    state = hanging().rest()
    assert isinstance(state, LineState)
    assert state.arc_lengths == pytest.approx(np.linspace(0.0, 300.0, 13))
    assert state.length == pytest.approx(300.0)


# Ropes that harden and relax.

ROPE = dataclasses.replace(
    LIMP,
    axial_stiffness=2.0e6,
    axial_damping=1.0e4,
    quadratic_hardening=15.0,
    cubic_hardening=200.0,
    relaxing_stiffness=2.0e6,
    relaxation_time=3.0,
)


@pytest.mark.parametrize("change", [40.0, -40.0])
def test_a_rope_carries_what_its_branches_hold_through_splits_and_merges(change):
    solver = hanging(line=Line.uniform(ROPE, 300.0))
    top = circling(0.05)
    length = 300.0 + change * np.linspace(0.0, 1.0, len(top)) ** 2
    whole = solver.simulate(top, dt=0.05, length=length)
    first = solver.simulate(top[:101], dt=0.05, length=length[:101])
    second = solver.simulate(top[100:], dt=0.05, length=length[100:], start=first.end)
    assert abs(len(whole.end.branch_strains) - 12) >= 1
    assert np.abs(first.end.branch_strains).max() > 1e-4
    assert len(whole.end.branch_strains) == len(whole.end.segment_lengths)
    assert second.end.branch_strains == pytest.approx(whole.end.branch_strains, abs=1e-12)
    assert second.end.positions == pytest.approx(whole.end.positions, abs=1e-8)
    assert copy.deepcopy(whole.end) == whole.end
    assert dataclasses.replace(whole.end, branch_strains=np.zeros(3)) != whole.end


def test_a_line_of_rope_below_wire_is_at_rest_and_its_wire_holds_nothing_that_pulls():
    line = Line(sections=(Section(cable=ROPE, length=100.0), Section(cable=LIMP, length=200.0)))
    solver = hanging(line=line, current=CURRENT)
    still = solver.rest()
    record = solver.simulate((0.0, 0.0, 0.0), dt=0.1, n_steps=100, start=still)
    assert np.abs(record.end.positions - still.positions).max() < 1e-6
    # The same line with wire throughout stretches by Hooke's law alone.
    strain = np.linalg.norm(np.diff(still.positions, axis=0), axis=1) / still.segment_lengths - 1.0
    assert strain[:4] == pytest.approx(static_strain(ROPE, still.tensions[:4]), rel=1e-6)
    assert strain[4:] == pytest.approx(still.tensions[4:] / LIMP.axial_stiffness, rel=1e-6)


def test_placed_rope_has_relaxed_and_energy_counts_what_branches_hold():
    solver = hanging(line=Line.uniform(ROPE, 300.0))
    state = solver.placed(solver.rest().positions)
    assert state.tensions == pytest.approx(solver.rest().tensions, rel=1e-9)
    held = dataclasses.replace(state, branch_strains=np.full(12, 0.01))
    assert solver.energy(held) - solver.energy(state) == pytest.approx(0.5 * 2e6 * 1e-4 * 300.0)


@few
@given(heave=st.floats(0.5, 8.0), period=st.floats(2.0, 15.0), relaxation_time=st.floats(0.05, 100.0))
def test_a_snapping_rope_never_pushes(heave, period, relaxation_time):
    rope = dataclasses.replace(ROPE, relaxation_time=relaxation_time)
    light = dataclasses.replace(PAYLOAD, submerged_weight=5000.0)
    solver = hanging(line=Line.uniform(rope, 300.0), payload=light)
    time = 0.05 * np.arange(301)
    top = np.zeros((301, 3))
    top[:, 2] = heave * np.sin(2.0 * math.pi * time / period)
    record = solver.simulate(top, dt=0.05)
    assert record.least_tension.min() >= 0.0
    assert np.all(np.isfinite(record.positions)) and np.all(np.isfinite(record.end.branch_strains))
