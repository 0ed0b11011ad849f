"""Natural modes: what the validation cases leave out, bad input, families, bodies and the contract."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heave_env.cable.statics import FixedEnds, Moored, OnSeabed, StaticsSolver, Towed
from heave_env.cable.waves import (
    IN_PLANE,
    OUT_OF_PLANE,
    SPATIAL,
    WavesSolver,
    hanging_line,
    inclined_line,
    transverse_wave_speed,
    travel_times,
)
from heave_env.parameters import Attachment, Cable, Current, Line, Payload, Section

CABLE = Cable(mass_per_length=7.2, axial_stiffness=1.58e7, submerged_weight=54.0, diameter=0.047)
UNIT = Payload(mass=5000.0, added_mass=8000.0, submerged_weight=35_000.0)
LINE = Line.uniform(CABLE, 300.0)

few = settings(max_examples=10, deadline=None, derandomize=True)


@few
@given(weight=st.floats(1.0, 100.0), span=st.floats(50.0, 295.0), rise=st.floats(-50.0, 50.0))
def test_frequencies_are_positive_and_modes_do_not_mix(weight, span, rise):
    cable = dataclasses.replace(CABLE, submerged_weight=weight)
    shape = inclined_line(
        Line.uniform(cable, 300.0), (-span, 0.0, -300.0 - rise), (0.0, 0.0, -300.0), n_segments=24
    )
    solver = WavesSolver(shape=shape, n_modes=10)
    modes = solver.solve()
    assert np.all(modes.omega > 0.0) and np.all(np.diff(modes.omega) >= 0.0)
    mass = solver._matrices[0]
    flat = modes.displacement.reshape(10, -1)
    overlap = flat @ mass @ flat.T
    scale = np.sqrt(np.diag(overlap))
    assert overlap / np.outer(scale, scale) == pytest.approx(np.eye(10), abs=1e-8)


def test_ends_that_are_held_do_not_move():
    shape = inclined_line(LINE, (-200.0, 0.0, -200.0), (0.0, 0.0, 0.0), n_segments=30)
    modes = WavesSolver(shape=shape).solve()
    assert not modes.displacement[:, [0, -1]].any()
    assert np.linalg.norm(modes.displacement, axis=2).max(axis=1) == pytest.approx(1.0)
    on_bed = StaticsSolver(
        line=LINE, ends=OnSeabed(payload=UNIT, height=-200.0, thrust=(5000.0, 0.0)), n_segments=30
    ).solve()
    modes = WavesSolver(shape=on_bed).solve()
    assert not modes.displacement[:, 0, 2].any()
    assert modes.displacement[:, 0, :2].any()


def test_motion_across_the_plane_does_not_stretch():
    modes = WavesSolver(shape=inclined_line(LINE, (-200.0, 0.0, -200.0), (0.0, 0.0, 0.0)), n_modes=12).solve()
    assert modes.of(OUT_OF_PLANE).stretch_share == pytest.approx(0.0, abs=1e-12)
    assert np.abs(modes.of(OUT_OF_PLANE).displacement[..., [0, 2]]).max() < 1e-12
    assert np.abs(modes.of(IN_PLANE).displacement[..., 1]).max() < 1e-12
    assert set(modes.family) == {IN_PLANE, OUT_OF_PLANE}


def test_heave_and_sway_of_a_unit_that_differ_split_a_hanging_line_all_the_same():
    unit = dataclasses.replace(UNIT, lateral_added_mass=1000.0)
    modes = WavesSolver(shape=hanging_line(LINE, unit), n_modes=40).solve()
    assert set(modes.family) == {IN_PLANE, OUT_OF_PLANE}
    swing = modes.of(OUT_OF_PLANE).omega[0]
    same = WavesSolver(shape=hanging_line(LINE, UNIT), n_modes=40).solve()
    # Less added mass in sway: a quicker swing; the same axial mode.
    assert swing > 1.1 * same.of(OUT_OF_PLANE).omega[0]
    axial = [m.omega[m.stretch_share > 0.5][0] for m in (modes, same)]
    assert axial[0] == pytest.approx(axial[1], rel=1e-9)


def test_a_weight_on_the_line_slows_it():
    ends = FixedEnds(lower=(-200.0, 0.0, -200.0), upper=(0.0, 0.0, 0.0))
    weightless = Payload(mass=2000.0, submerged_weight=0.0)
    loaded = Line(sections=LINE.sections, attachments=(Attachment(arc_length=150.0, body=weightless),))
    plain, slowed = (
        WavesSolver(shape=StaticsSolver(line=line, ends=ends).solve(), n_modes=2).solve().omega[0]
        for line in (LINE, loaded)
    )
    assert slowed < 0.7 * plain


def test_two_sections_alike_are_one():
    halves = Line(sections=(Section(cable=CABLE, length=150.0), Section(cable=CABLE, length=150.0)))
    one, two = (WavesSolver(shape=hanging_line(line, UNIT)).solve().omega for line in (LINE, halves))
    assert two == pytest.approx(one, rel=1e-9)


def test_a_line_across_a_current_has_a_tilted_plane_and_still_two_families():
    neutral = dataclasses.replace(CABLE, submerged_weight=0.0)
    ends = FixedEnds(lower=(0.0, -120.0, -100.0), upper=(0.0, 120.0, -100.0))
    shape = StaticsSolver(
        line=Line.uniform(neutral, 300.0), ends=ends, current=Current.uniform(1.0), n_segments=40
    ).solve()
    assert set(WavesSolver(shape=shape).solve().family) <= {IN_PLANE, OUT_OF_PLANE}
    sheared = Current(depth=(0.0, 300.0), speed=(0.8, 0.4), direction=(0.0, 1.5))
    twisted = StaticsSolver(line=LINE, ends=Towed(payload=UNIT), current=sheared, n_segments=30).solve()
    assert set(WavesSolver(shape=twisted).solve().family) == {SPATIAL}


def test_still_water_does_not_damp_and_a_current_does():
    still = WavesSolver(shape=hanging_line(LINE, UNIT)).solve()
    assert not still.damping_ratio.any()
    shape = StaticsSolver(line=LINE, ends=Towed(payload=UNIT), current=Current.uniform(0.5)).solve()
    assert WavesSolver(shape=shape).solve().damping_ratio.min() > 0.0


def test_a_moored_lines_upper_end_counts_as_held():
    shape = StaticsSolver(
        line=LINE, ends=Moored(anchor=(0.0, 0.0, -200.0), upper_height=0.0, pull=(20_000.0, 0.0))
    ).solve()
    assert not WavesSolver(shape=shape).solve().displacement[:, -1].any()


def test_transverse_waves_are_slower_than_longitudinal_ones():
    longitudinal, transverse = travel_times(hanging_line(LINE, UNIT))
    assert longitudinal == pytest.approx(300.0 / math.sqrt(1.58e7 / 7.2), rel=1e-9)
    assert transverse > 5.0 * longitudinal


def test_periods_belong_to_the_frequencies():
    modes = WavesSolver(shape=hanging_line(LINE, UNIT)).solve()
    assert modes.period * modes.omega == pytest.approx(2.0 * math.pi)


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="tension must not be negative"):
        transverse_wave_speed(CABLE, -1.0)
    massless = dataclasses.replace(CABLE, mass_per_length=0.0)
    with pytest.raises(ValueError, match="mass_per_length above zero"):
        WavesSolver(shape=hanging_line(Line.uniform(massless, 300.0), UNIT))
    with pytest.raises(ValueError, match="n_modes must be at most the 12 "):
        WavesSolver(shape=hanging_line(LINE, UNIT, n_segments=4), n_modes=13)
    taut = inclined_line(LINE, (0.0, 0.0, -300.1), (0.0, 0.0, 0.0), n_segments=3)
    limp = dataclasses.replace(taut, force=0.0 * taut.force, load=0.0 * taut.load)
    with pytest.raises(ValueError, match="need a taut line, got no tension at 0 m"):
        WavesSolver(shape=limp)
