"""The towed cable: what it refuses, its symmetries, and its limits for any cable."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.cases.towing import light_towed_cable
from heave_env.cable.towing import (
    Towing,
    cable_froude_number,
    critical_payout_ratio,
    froude_number,
    inclination,
    tension_ratio,
)

CABLE = light_towed_cable().cable
few = settings(max_examples=40, deadline=None, derandomize=True)


def between(low, high):
    return st.floats(low, high, allow_nan=False)


def weighing(weight, **changes):
    return dataclasses.replace(CABLE, submerged_weight=weight, **changes)


@pytest.mark.parametrize(
    ("deed", "sentence"),
    [
        (lambda: Towing(cable=weighing(-0.1), length=10.0, speed=1.0), "floats trails on the surface"),
        (
            lambda: cable_froude_number(weighing(-0.1), 1.0),
            "must not be negative for a straight tow, got -0.1",
        ),
        (
            lambda: Towing(cable=CABLE, length=0.0, speed=1.0),
            "Towing.length must be a positive number, got 0.0",
        ),
        (
            lambda: Towing(cable=CABLE, length=10.0, speed=-1.0),
            "Towing.speed must be a number that is not neg",
        ),
        (lambda: Towing(cable=CABLE, length=10.0, speed=1.0, payout_rate=math.nan), "Towing.payout_rate"),
        (
            lambda: Towing(cable=CABLE, length=1.0, speed=1.0, strumming_augmentation=-0.1),
            "strumming_augment",
        ),
        (lambda: Towing(cable=weighing(0.0), length=10.0, speed=0.0), "positive for a cable without weight"),
        (
            lambda: Towing(cable=weighing(0.0, normal_drag_coefficient=0.0), length=10.0, speed=1.0),
            "Cable.normal_drag_coefficient must be a positive number",
        ),
        (lambda: Towing(cable=CABLE, length=1.0, speed=1.0).solve(1), "n_points must be at least 2, got 1"),
        (lambda: inclination(-1.0, 1.2), "must not be negative, got -1.0"),
        (lambda: inclination(math.nan, 1.2), "must not be negative, got nan"),
        (lambda: froude_number(2.0, 1.2), "inclination must lie between 0 and pi/2 rad, got 2.0"),
        (lambda: froude_number(0.5, 0.0), "normal_drag_coefficient must be positive, got 0.0"),
        (lambda: tension_ratio(0.0, 0.5, 0.01), "inclination must be positive"),
        (lambda: critical_payout_ratio(0.5, -0.01), "drag_ratio must not be negative, got -0.01"),
    ],
)
def test_bad_input_is_named_with_its_value(deed, sentence):
    with pytest.raises(ValueError, match=sentence):
        deed()


@few
@given(between(0.0, 20.0), between(0.0, 50.0), between(-5.0, 25.0), between(0.0, 0.5))
def test_any_tow_is_finite_and_lies_on_its_line(speed, weight, rate, strumming):
    tow = Towing(
        cable=weighing(weight + 1e-6),
        length=300.0,
        speed=speed,
        payout_rate=rate,
        strumming_augmentation=strumming,
    )
    found = tow.solve(n_points=11)
    assert np.isfinite(found.tension).all() and np.isfinite(found.x).all()
    assert 0.0 <= found.inclination <= 0.5 * math.pi
    assert found.x[-1] == found.z[-1] == 0.0
    assert math.atan2(found.depth, found.layback) == pytest.approx(found.inclination, abs=1e-12)
    assert found.top_tension == pytest.approx(found.weight_tension + found.drag_tension)
    assert found.stays_taut == (rate < found.critical_payout_rate)


@few
@given(between(0.0, 1e6), between(0.1, 4.0))
def test_angle_and_froude_number_undo_each_other(froude, coefficient):
    angle = inclination(froude, coefficient)
    assert froude_number(angle, coefficient) == pytest.approx(froude, rel=1e-9, abs=1e-9)


@few
@given(between(0.01, 1.5), between(1e-4, 0.5))
def test_at_the_critical_ratio_the_tension_vanishes(angle, drag_ratio):
    critical = critical_payout_ratio(angle, drag_ratio)
    # Around the root the ratio is a difference of ones.
    assert tension_ratio(angle, critical, drag_ratio) == pytest.approx(0.0, abs=1e-6)


def test_a_weightless_cable_lies_along_the_flow_and_still_pulls():
    found = Towing(cable=weighing(0.0), length=100.0, speed=2.0).solve()
    assert found.inclination == 0.0 and found.depth == 0.0
    assert found.top_tension == pytest.approx(CABLE.tangential_drag_per_length * 4.0 * 100.0)
    assert found.critical_payout_rate == 2.0


def test_a_cable_without_normal_drag_hangs_at_any_speed():
    found = Towing(cable=weighing(0.6, normal_drag_coefficient=0.0), length=100.0, speed=2.0).solve()
    assert found.inclination == 0.5 * math.pi
    assert found.layback == pytest.approx(0.0, abs=1e-12)


def test_heavier_cables_and_slower_tows_hang_steeper():
    speeds = [
        Towing(cable=CABLE, length=100.0, speed=speed).inclination for speed in (0.0, 0.5, 1.0, 2.0, 8.0)
    ]
    weights = [Towing(cable=weighing(w), length=100.0, speed=2.0).inclination for w in (0.0, 0.1, 1.0, 10.0)]
    assert speeds == sorted(speeds, reverse=True)
    assert weights == sorted(weights)


def test_length_scales_tension_and_depth_alike():
    short, long = (Towing(cable=CABLE, length=length, speed=2.0).solve() for length in (100.0, 300.0))
    assert long.top_tension == pytest.approx(3.0 * short.top_tension)
    # Not quite the depth: three times the tension stretches the longer cable more.
    assert long.depth == pytest.approx(3.0 * short.depth, rel=1e-3)
    assert long.elongation == pytest.approx(9.0 * short.elongation, rel=1e-6)
