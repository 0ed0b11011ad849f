"""The static shape: bad input, invariants, robustness, contract; its validation cases hold the rest."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heave_env.cable.constitutive import static_tension
from heave_env.cable.convergence import ConvergenceError
from heave_env.cable.statics import (
    FixedEnds,
    FootprintSolver,
    Moored,
    OnSeabed,
    StaticsSolver,
    Towed,
)
from heave_env.parameters import Attachment, Cable, Current, Line, Payload, Section

CABLE = Cable(
    mass_per_length=1.05,
    axial_stiffness=1.6e8,
    submerged_weight=2.25,
    diameter=0.032,
    tangential_drag_coefficient=0.01,
)
UNIT = Payload(mass=1000.0, submerged_weight=3000.0, drag_area=1.0)
LINE = Line.uniform(CABLE, 350.0)
SPAN = FixedEnds(lower=(-250.0, 0.0, -150.0), upper=(0.0, 0.0, 0.0))

few = settings(max_examples=15, deadline=None, derandomize=True)


def of_weight(weight: float) -> Cable:
    return dataclasses.replace(CABLE, submerged_weight=weight)


def turned(vector: np.ndarray, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(vector) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


@few
@given(
    angle=st.floats(-math.pi, math.pi),
    speed=st.floats(0.0, 2.0),
    shear=st.floats(-3.0, 3.0),
    kind=st.sampled_from(["fixed", "towed", "moored", "seabed"]),
)
def test_turning_everything_about_the_vertical_turns_the_shape(angle, speed, shear, kind):
    # Rounding alone may differ; 1e-7 of the length leaves room for a steep Newton.
    def shape(turn: float):
        def xy(x: float, y: float) -> tuple[float, float]:
            there = turned(np.array([x, y, 0.0]), turn)
            return float(there[0]), float(there[1])

        ends = {
            "fixed": FixedEnds(lower=(*xy(-200.0, 30.0), -250.0), upper=(*xy(20.0, 0.0), -50.0)),
            "towed": Towed(payload=UNIT, upper=(*xy(5.0, 5.0), 0.0), velocity=xy(0.5, 0.2)),
            "moored": Moored(anchor=(*xy(0.0, 10.0), -250.0), upper_height=-20.0, pull=xy(2000.0, 100.0)),
            "seabed": OnSeabed(payload=UNIT, height=-250.0, thrust=xy(400.0, 100.0)),
        }[kind]
        current = Current(depth=(0.0, 300.0), speed=(speed, 0.3 * speed), direction=(turn, turn + shear))
        return StaticsSolver(line=LINE, ends=ends, current=current, n_segments=30).solve()

    try:
        still, moved = shape(0.0), shape(angle)
    except ValueError as error:
        assert "lifts the line" in str(error)
        return
    assert moved.position == pytest.approx(turned(still.position, angle), abs=1e-7 * 350.0)
    assert moved.tension == pytest.approx(still.tension, rel=1e-7)


@few
@given(
    speed=st.floats(0.05, 1.5), bearing=st.floats(0.0, 6.28), weight=st.sampled_from([-2.0, 0.0, 2.25, 50.0])
)
def test_the_number_of_segments_matters_little(speed, bearing, weight):
    ends = FixedEnds(lower=(-250.0, 0.0, -400.0), upper=(0.0, 0.0, -300.0))
    solver = StaticsSolver(
        line=Line.uniform(of_weight(weight), 350.0), ends=ends, current=Current.uniform(speed, bearing)
    )
    fine = dataclasses.replace(solver, n_segments=400)
    # Second order: 100 segments are within 0.5 % even where a slack line all but folds along the current.
    greatest = fine.solve().tension.max()
    assert solver.solve().tension.max() == pytest.approx(greatest, rel=5e-3)


@few
@given(seed=st.integers(0, 10_000))
def test_any_line_in_any_current_finds_its_shape_and_balances(seed):
    rng = np.random.default_rng(seed)
    length = float(rng.uniform(100.0, 1000.0))
    bodies = tuple(
        Attachment(
            arc_length=float(rng.uniform(0.0, length)),
            body=Payload(mass=10.0, submerged_weight=float(rng.normal(0.0, 500.0)), drag_area=0.5),
        )
        for _ in range(3)
    )
    weight = float(rng.choice([0.0, 0.1, 2.0, 50.0]))
    sections = tuple(Section(cable=of_weight(w), length=0.5 * length) for w in (weight, -weight))
    line = Line(sections=sections, attachments=bodies)
    away = rng.normal(size=3)
    away *= length * rng.uniform(0.05, 0.999) / np.linalg.norm(away)
    ends = FixedEnds(
        lower=(0.0, 0.0, -2000.0), upper=(float(away[0]), float(away[1]), float(away[2]) - 2000.0)
    )
    current = Current(
        depth=(0.0, 1500.0, 3000.0),
        speed=tuple(rng.uniform(0.0, 3.0, 3)),
        direction=tuple(rng.uniform(0.0, 6.0, 3)),
    )
    shape = StaticsSolver(line=line, ends=ends, current=current, n_segments=50).solve()
    assert np.all(np.isfinite(shape.position)) and np.all(np.isfinite(shape.force))
    assert shape.position[-1] == pytest.approx(ends.upper, abs=1e-8 * length)
    assert shape.residual < 1e-9


@pytest.mark.parametrize("weight", [1e-3, 1e-6, 1e-9, 0.0])
def test_weight_may_fade_away(weight):
    # Towards neutral buoyancy the shape goes over into that of no weight at all.
    current = Current.uniform(0.5, 0.5 * math.pi)
    shapes = [
        StaticsSolver(line=Line.uniform(of_weight(w), 350.0), ends=SPAN, current=current).solve()
        for w in (weight, 0.0)
    ]
    assert shapes[0].position == pytest.approx(shapes[1].position, abs=1e-9 + 20.0 * weight)


@pytest.mark.parametrize("offset", [1.0, 1e-3, 1e-6, 1e-9, 0.0])
def test_a_line_may_come_upright(offset):
    ends = FixedEnds(lower=(offset, 0.0, -349.0), upper=(0.0, 0.0, 0.0))
    shape = StaticsSolver(line=LINE, ends=ends).solve()
    assert np.all(np.isfinite(shape.force))
    # A metre of slack hangs as a fold at the bottom: the upper end carries all but half a metre.
    assert shape.tension[-1] == pytest.approx(2.25 * 349.5, rel=0.01)


def test_a_taut_line_is_nearly_straight_and_as_tight_as_it_is_stretched():
    ends = FixedEnds(lower=(-350.35, 0.0, -10.0), upper=(0.0, 0.0, -10.0))
    shape = StaticsSolver(line=LINE, ends=ends).solve()
    # 0.1 % of strain and, from the sag, (w L / T)² / 24 more: a thousandth of it.
    assert shape.tension.mean() == pytest.approx(1.6e5 * 1.001, rel=1e-4)
    assert shape.strain.max() == pytest.approx(1e-3, rel=2e-3)


def test_a_buoyant_line_is_a_heavy_one_upside_down():
    def shape(weight: float, sign: float):
        ends = FixedEnds(lower=(-250.0, 0.0, -500.0), upper=(0.0, 0.0, -500.0 + sign * 150.0))
        return StaticsSolver(
            line=Line.uniform(of_weight(weight), 350.0), ends=ends, current=Current.uniform(0.4, 1.0)
        ).solve()

    heavy, floating = shape(2.0, 1.0), shape(-2.0, -1.0)
    assert floating.tension == pytest.approx(heavy.tension, rel=1e-9)
    assert floating.position[:, 2] + 500.0 == pytest.approx(-(heavy.position[:, 2] + 500.0), abs=1e-7)


def test_towing_through_still_water_is_a_current_past_a_vessel_at_rest():
    current = StaticsSolver(line=LINE, ends=Towed(payload=UNIT), current=Current.uniform(-1.0)).solve()
    towed = StaticsSolver(line=LINE, ends=Towed(payload=UNIT, velocity=(1.0, 0.0))).solve()
    assert towed.position == pytest.approx(current.position, abs=1e-9)


def test_thrust_of_the_unit_moves_it():
    pushed = StaticsSolver(line=LINE, ends=Towed(payload=UNIT, thrust=(0.0, 500.0, 0.0))).solve()
    assert pushed.lower_force == pytest.approx([0.0, -500.0, 3000.0], abs=1e-8)
    assert pushed.position[0, 1] > 40.0


def test_the_current_is_taken_at_its_instant():
    current = Current(speed=(1.0,), time=(0.0, 100.0), factor=(0.0, 1.0))
    half = StaticsSolver(line=LINE, ends=SPAN, current=current, time=50.0).solve()
    steady = StaticsSolver(line=LINE, ends=SPAN, current=Current.uniform(0.5)).solve()
    assert half.position == pytest.approx(steady.position, abs=1e-9)


def test_samples_join_the_nodes():
    shape = StaticsSolver(line=LINE, ends=SPAN, current=Current.uniform(0.5, 1.0), n_segments=40).solve()
    position, force = shape.sample(shape.arc_length)
    assert position == pytest.approx(shape.position, abs=1e-9)
    assert force == pytest.approx(shape.force, abs=1e-6)
    coarse, _ = shape.sample(np.array([[10.0, 20.0], [30.0, 340.0]]))
    assert coarse.shape == (2, 2, 3)
    with pytest.raises(ValueError, match="between 0 and 350 m"):
        shape.sample(351.0)


def test_sections_and_bodies_lie_on_nodes():
    line = Line(
        sections=(Section(cable=CABLE, length=33.3), Section(cable=of_weight(9.0), length=66.7)),
        attachments=(
            Attachment(arc_length=50.0, body=UNIT),
            Attachment(arc_length=33.3, body=UNIT),
            Attachment(arc_length=50.0, body=UNIT),
        ),
    )
    solver = StaticsSolver(line=line, ends=Towed(payload=UNIT), n_segments=7)
    assert {33.3, 50.0, 100.0} <= set(np.round(solver.arc_length, 9))
    shape = solver.solve()
    # Unit, two bodies at 50 m and one at 33.3 m, and both sections.
    assert shape.tension[-1] == pytest.approx(4 * 3000.0 + 2.25 * 33.3 + 9.0 * 66.7, rel=1e-12)
    assert list(solver.section) == sorted(solver.section)


def test_angles_and_end_forces():
    shape = StaticsSolver(line=LINE, ends=SPAN).solve()
    assert shape.upper_force == pytest.approx(-shape.force[-1])
    assert shape.inclination[-1] == pytest.approx(math.atan2(shape.force[-1, 2], shape.force[-1, 0]))
    assert shape.bearing[-1] == pytest.approx(0.0)
    assert np.linalg.norm(shape.tangent, axis=1) == pytest.approx(1.0)
    assert shape.span == pytest.approx([250.0, 0.0, 150.0])


def test_a_guess_saves_steps_and_changes_nothing():
    solver = StaticsSolver(line=LINE, ends=SPAN, current=Current.uniform(0.52, 0.3))
    near = StaticsSolver(line=LINE, ends=SPAN, current=Current.uniform(0.51, 0.3)).solve()
    cold, warm = solver.solve(), solver.solve(near)
    assert warm.n_iterations <= cold.n_iterations
    assert warm.position == pytest.approx(cold.position, abs=1e-8)
    with pytest.raises(ValueError, match="guess must have the solver's 101 nodes, got 31"):
        solver.solve(dataclasses.replace(solver, n_segments=30).solve())


def test_a_poor_guess_does_not_mislead():
    solver = StaticsSolver(line=LINE, ends=SPAN, current=Current.uniform(0.5, 0.3))
    good = solver.solve()
    wild = dataclasses.replace(good, position=-3.0 * good.position, force=-good.force)
    assert solver.solve(wild).position == pytest.approx(good.position, abs=1e-7)


def test_where_drag_dominates_the_current_is_raised_step_by_step():
    # All but weightless, level, exactly along the current: Newton alone fails, continuation does not.
    def shape(direction: float):
        ends = FixedEnds(lower=(-210.0, 0.0, -500.0), upper=(0.0, 0.0, -500.0))
        line = Line.uniform(dataclasses.replace(of_weight(0.01), tangential_drag_coefficient=0.0), 350.0)
        return StaticsSolver(line=line, ends=ends, current=Current.uniform(0.5, direction)).solve()

    along = shape(0.0)
    assert along.n_iterations > 60
    assert along.residual < 1e-9
    assert np.abs(along.position[:, 1]).max() < 1e-6
    assert along.position[:, 2].min() < -505.0


def test_shapes_pickle_and_do_not_change():
    shape = StaticsSolver(line=LINE, ends=SPAN).solve()
    again = pickle.loads(pickle.dumps(copy.deepcopy(shape)))
    assert np.array_equal(again.position, shape.position)
    with pytest.raises(dataclasses.FrozenInstanceError):
        shape.residual = 0.0  # type: ignore[misc]


def test_a_solve_takes_about_a_millisecond():
    solver = StaticsSolver(line=LINE, ends=SPAN, current=Current.uniform(0.5, 0.3))
    solver.solve()
    best = math.inf
    for _ in range(20):
        start = time.perf_counter()
        solver.solve()
        best = min(best, time.perf_counter() - start)
    print(f"100 segments in a current: {1e3 * best:.2f} ms a solve")
    assert best < 0.02  # twenty times the usual, for a busy machine


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"ends": FixedEnds(lower=(0.0, 0.0, -400.0), upper=(0.0, 0.0, 0.0))}, "cannot reach over 400 m"),
        ({"n_segments": 0}, "n_segments must be an integer of at least 1"),
        ({"tolerance": -1.0}, "tolerance must be a positive number"),
        ({"time": math.nan}, "time must be a finite number"),
        ({"ends": Moored(anchor=(0.0, 0.0, -400.0), upper_height=0.0, pull=(0.0, 0.0))}, "cannot reach"),
        ({"ends": OnSeabed(payload=UNIT, height=-400.0)}, "cannot reach over 400 m"),
        ({"line": Line.uniform(of_weight(0.0), 350.0)}, "has no shape of its own"),
    ],
)
def test_impossible_systems_are_named(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        StaticsSolver(**{"line": LINE, "ends": SPAN, **change})


def test_a_line_that_does_not_stretch_cannot_reach_past_its_length():
    stiff = dataclasses.replace(CABLE, axial_stiffness=1e15)
    ends = FixedEnds(lower=(-350.01, 0.0, 0.0), upper=(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="bring the ends together or lengthen it"):
        StaticsSolver(line=Line.uniform(stiff, 350.0), ends=ends)


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (lambda: FixedEnds(lower=(0.0, 0.0), upper=(0.0, 0.0, 0.0)), "lower must be 3 finite numbers"),
        (lambda: Towed(payload=UNIT, velocity=(math.inf, 0.0)), "velocity must be 2 finite numbers"),
        (lambda: Moored(anchor=(0.0, 0.0, 0.0), upper_height=math.nan, pull=(0.0, 0.0)), "upper_height"),
        (
            lambda: OnSeabed(payload=Payload(mass=10.0, submerged_weight=-5.0), height=-10.0),
            "submerged_weight must be a number that is not negative",
        ),
        (
            lambda: FootprintSolver(line=LINE, payload=UNIT, depth=400.0, thrust=1.0),
            "depth must be less than",
        ),
        (
            lambda: FootprintSolver(line=LINE, payload=UNIT, depth=200.0, thrust=0.0),
            "thrust must be a positive",
        ),
        (
            lambda: FootprintSolver(line=LINE, payload=UNIT, depth=200.0, thrust=1.0, shortest_length=100.0),
            "shortest_length must be from the depth",
        ),
    ],
)
def test_bad_ends_are_named(build, sentence):
    with pytest.raises(ValueError, match=sentence):
        build()


def test_a_current_that_lifts_the_line_out_of_the_sea_is_named():
    line = Line.uniform(of_weight(-2.0), 300.0)
    ends = FixedEnds(lower=(0.0, 0.0, -90.0), upper=(50.0, 0.0, -90.0))
    with pytest.raises(ValueError, match="lifts the line to .* above the surface"):
        StaticsSolver(line=line, ends=ends, current=Current.uniform(0.3)).solve()


def test_a_current_that_blows_the_line_out_is_named():
    soft = dataclasses.replace(CABLE, axial_stiffness=1e5)
    with pytest.raises(ValueError, match="more than any cable bears; lower the current"):
        StaticsSolver(
            line=Line.uniform(soft, 350.0), ends=SPAN, current=Current.uniform(20.0, 0.5 * math.pi)
        ).solve()


def test_a_shape_that_is_not_found_says_so_with_its_residual():
    solver = StaticsSolver(line=LINE, ends=SPAN, current=Current.uniform(0.5), tolerance=1e-30)
    with pytest.raises(ConvergenceError, match="of the current") as caught:
        solver.solve()
    assert 0.0 < caught.value.residual < 1e-10


def test_a_vessel_that_keeps_cable_in_reaches_as_far_while_the_line_stays_off_the_bed():
    unit = Payload(mass=1000.0, submerged_weight=800.0, drag_area=1.0)
    solver = FootprintSolver(
        line=LINE, payload=unit, depth=200.0, thrust=500.0, current=Current.uniform(0.257), n_bearings=8
    )
    fixed = solver.solve()
    free = dataclasses.replace(solver, shortest_length=210.0).solve()
    assert fixed.clearance.min() < -0.1  # upstream the whole line would lie on the bed
    assert free.clearance.min() > -1e-3
    assert free.length[4] < 349.0
    assert free.length[0] == pytest.approx(350.0)
    assert np.all(free.lift <= unit.submerged_weight)


def test_bearings_that_the_unit_cannot_reach_are_left_empty():
    unit = Payload(mass=1000.0, submerged_weight=3000.0, drag_area=1.0)
    found = FootprintSolver(
        line=LINE, payload=unit, depth=200.0, thrust=500.0, current=Current.uniform(1.0), n_bearings=12
    ).solve()
    assert np.isfinite(found.reach[0]) and np.isnan(found.reach[6])


ROPE = dataclasses.replace(CABLE, axial_stiffness=2e6, quadratic_hardening=15.0, cubic_hardening=200.0)


def test_a_hardening_rope_is_sampled_exactly_and_strained_by_its_law():
    line = Line(sections=(Section(cable=ROPE, length=200.0), Section(cable=CABLE, length=150.0)))
    ends = FixedEnds(lower=(-300.0, 0.0, -150.0), upper=(45.0, 0.0, 0.0))
    coarse, fine = (StaticsSolver(line=line, ends=ends, n_segments=n).solve() for n in (7, 140))
    at = np.linspace(0.0, 350.0, 57)
    for rough, exact in zip(coarse.sample(at), fine.sample(at), strict=True):
        assert rough == pytest.approx(exact, rel=1e-7, abs=1e-6)
    soft = fine.section == 0
    assert static_tension(ROPE, fine.strain[soft]) == pytest.approx(fine.greatest_tension[soft], rel=1e-9)
    assert fine.strain[~soft] == pytest.approx(fine.greatest_tension[~soft] / 1.6e8)


@few
@given(
    k2=st.floats(-10.0, 40.0),
    k3=st.floats(40.0, 900.0),
    upper=st.floats(-100.0, 355.0),
    speed=st.floats(0.0, 1.0),
)
def test_a_hardening_rope_settles_wherever_a_hookean_one_does(k2, k3, upper, speed):
    rope = dataclasses.replace(ROPE, quadratic_hardening=k2, cubic_hardening=k3, tension_only=True)
    line = Line.uniform(dataclasses.replace(rope, submerged_weight=10.0), 350.0)
    ends = FixedEnds(lower=(0.0, 0.0, -150.0), upper=(upper, 0.0, 0.0))
    shape = StaticsSolver(line=line, ends=ends, current=Current.uniform(speed, 1.0), n_segments=30).solve()
    # Moved by a little, its force changes as the shape's own stiffness says: one law, one gradient.
    assert shape.residual < 1e-9 and np.all(np.isfinite(shape.force))
    balance = shape.force[-1] - shape.force[0] + np.diff(shape.arc_length) @ shape.load
    assert np.abs(balance).max() < 1e-6 * shape.tension.max()


def test_a_hardening_rope_that_cannot_reach_is_refused_with_its_own_tension():
    # EA (0.3 + 15 · 0.3² + 200 · 0.3³) = 14.1 MN, where Hooke's law would say 0.6 MN and let it pass.
    line, ends = Line.uniform(ROPE, 100.0), FixedEnds(lower=(0.0, 0.0, -130.0), upper=(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"would carry 1\.41e\+07 N, a strain of 0\.3;"):
        StaticsSolver(line=line, ends=ends)
    soft = dataclasses.replace(ROPE, quadratic_hardening=0.0, cubic_hardening=0.0)
    StaticsSolver(line=Line.uniform(soft, 100.0), ends=ends)
