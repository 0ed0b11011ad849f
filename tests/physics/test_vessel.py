"""Vessel tables: signs, lever arms and headings are those of a rigid body; nonsense is refused."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from heave_env.parameters import GRAVITY, SeaState, Vessel, VesselTable
from heave_env.plant import simulate
from heave_env.rao import MOTIONS, SHIPPED, boom_tip_response, read_responses, responses_of
from heave_env.scenarios import Scenario, from_mapping, load, read, to_mapping, to_yaml, with_value
from heave_env.vessel import (
    boom_tip_components,
    boom_tip_filter,
    boom_tip_fit,
    boom_tip_lines,
    boom_tip_spectrum,
    fit_vessel,
    heave_response,
    true_boom_tip_spectrum,
)

SEA = SeaState(
    significant_wave_height=2.5,
    peak_omega=2.0 * math.pi / 8.0,
    spectrum="jonswap",
    filter="fitted",
    filter_order=6,
)
CRANE = VesselTable(heading=math.radians(150.0), boom_tip_x=-30.0, boom_tip_y=14.0)


def operation(vessel: VesselTable = CRANE, **sea) -> Scenario:
    return dataclasses.replace(
        load("thesis_linear"),
        vessel=None,
        vessel_table=vessel,
        sea_state=dataclasses.replace(SEA, **sea),
    )


def write_table(path, responses, omega, headings=(0.0, math.pi)) -> str:
    """A table in which every heading has the same complex responses by motion, others none."""
    columns = [f"{motion}_{part}" for motion in MOTIONS for part in ("amplitude", "phase")]
    rows = [",".join(["heading", "omega", *columns])]
    none = np.zeros(len(omega))
    for heading in headings:
        for i, w in enumerate(omega):
            values = [complex(responses.get(motion, none)[i]) for motion in MOTIONS]
            cells = [f"{abs(v)!r},{math.atan2(v.imag, v.real)!r}" for v in values]
            rows.append(f"{heading!r},{float(w)!r},{','.join(cells)}")
    path.write_text("\n".join(rows) + "\n")
    return str(path)


# Signs and lever arms ----------------------------------------------------------------------------


def test_lever_arms_are_those_of_a_small_rotation():
    from scipy.spatial.transform import Rotation

    roll, pitch, x, y = 1e-5, 2e-5, -30.0, 14.0
    turned = Rotation.from_rotvec([roll, pitch, 0.0]).apply([x, y, 8.0])
    assert turned[2] - 8.0 == pytest.approx(y * roll - x * pitch, rel=1e-4)
    table = responses_of(CRANE)
    omega = table.omega[[3, 20]]
    i = 5  # 150 degrees is one of the table's headings
    by_hand = table.heave[i] - x * table.pitch[i] + y * table.roll[i]
    assert boom_tip_response(omega, CRANE) == pytest.approx(by_hand[[3, 20]])


@pytest.mark.parametrize("heading", [0.0, 30.0, 90.0, 120.0, 180.0])
@pytest.mark.parametrize("place", [(-30.0, 14.0), (40.0, -9.0)])
def test_in_long_waves_the_boom_tip_follows_the_water_beneath_it(heading, place):
    # In waves of 1.5 km the whole vessel lies on one slope: the elevation at a point is that at the reference
    # point delayed by k·r. This fixes the signs of roll, pitch, headings and phases at once.
    x, y = place
    beta = math.radians(heading)
    vessel = VesselTable(heading=beta, boom_tip_x=x, boom_tip_y=y)
    omega = 0.2
    k = omega**2 / GRAVITY
    there = np.exp(-1j * k * (x * math.cos(beta) + y * math.sin(beta)))
    # Roll is amplified by 1/(1 - (0.2/0.48)²), 20 %, on its way to resonance; the hull is 100 m long.
    found = boom_tip_response(np.array([omega]), vessel)[0]
    assert found == pytest.approx(there, abs=0.02)
    assert abs(found - 1.0) > 0.4 * abs(there - 1.0)


def test_at_zero_frequency_the_vessel_is_carried_along():
    assert boom_tip_response(np.array([0.0]), CRANE)[0] == 1.0


def test_the_shipped_hull_is_alike_fore_and_aft_and_does_not_roll_head_on():
    table = responses_of(CRANE)
    assert table.heading == pytest.approx(np.radians(np.arange(0, 181, 30)), abs=1e-6)
    assert np.all(table.roll[[0, -1]] == 0.0)
    # The mesh and the Green function of single precision leave 1 % of the roll's largest.
    assert np.abs(table.heave[1] - table.heave[5]).max() < 0.01
    assert np.abs(table.pitch[1] + table.pitch[5]).max() < 0.01 * np.abs(table.pitch).max()
    assert np.abs(table.roll[2] - table.roll[4]).max() < 0.02 * np.abs(table.roll).max()


def test_the_shipped_hull_rolls_at_its_natural_frequency():
    # GM 2 m and a gyradius of 0.38 B: 12.7 s with the added inertia of 15 to 25 % of such hulls.
    table = responses_of(CRANE)
    peak = float(table.omega[np.argmax(np.abs(table.roll[3]))])
    gyradius = 0.38 * 22.0
    dry = math.sqrt(GRAVITY * 2.0) / gyradius
    assert 0.85 * dry < peak < dry


def test_between_headings_and_frequencies_responses_are_linear():
    table = responses_of(CRANE)
    one, two = (table.boom_tip(table.omega[:2], h, -30.0, 14.0) for h in table.heading[3:5])
    middle = float(0.5 * (table.heading[3] + table.heading[4]))
    half = table.boom_tip(np.array([0.5 * (table.omega[0] + table.omega[1])]), middle, -30.0, 14.0)
    assert half[0] == pytest.approx(0.25 * (one.sum() + two.sum()))


# A choice changes what it should, and nothing else -----------------------------------------------


def test_a_vessel_that_follows_the_water_is_no_vessel(tmp_path):
    omega = np.linspace(0.1, 9.0, 50)
    path = write_table(tmp_path / "raft.csv", {"heave": np.ones(50)}, omega)
    raft = VesselTable(table=path, heading=1.0, boom_tip_x=50.0, boom_tip_y=20.0)
    phases = dataclasses.replace(SEA, kind="random_phase")
    with_table, without = boom_tip_components(phases, raft), boom_tip_components(phases, None)
    assert with_table.amplitude == pytest.approx(without.amplitude, rel=1e-12)
    grid = np.linspace(0.1, 4.0, 40)
    assert boom_tip_spectrum(grid, phases, raft) == pytest.approx(boom_tip_spectrum(grid, phases, None))
    # Two fits to one spectrum, but for the little that the elevation's is scaled by.
    of_tip, of_water = (boom_tip_filter(SEA, vessel).response(grid)[:, 0] for vessel in (raft, None))
    assert np.abs(of_tip) == pytest.approx(np.abs(of_water), rel=2e-3)


def test_an_arm_athwart_has_no_say_in_head_seas():
    head = {"heading": math.pi, "boom_tip_x": -30.0}
    one, two = (operation(VesselTable(boom_tip_y=y, **head), kind="random_phase") for y in (0.0, 14.0))
    a, b = (simulate(s, seeds=[5], duration=5.0) for s in (one, two))
    assert all(np.array_equal(a[name], b[name]) for name in a)
    assert one.fingerprint != two.fingerprint


def test_a_table_changes_the_boom_tip_and_nothing_else():
    before = load("sea_state_5")
    sea = dataclasses.replace(before.sea_state, filter="fitted")
    after = dataclasses.replace(before, sea_state=sea, vessel=None, vessel_table=CRANE)
    names = ("observation_names", "n_pending", "static_tension", "observed_lags")
    assert all(getattr(after, name) == getattr(before, name) for name in names)
    assert after.n_filter_states == 6
    calm = [
        dataclasses.replace(s, sea_state=dataclasses.replace(s.sea_state, kind="calm"))
        for s in (before, after)
    ]
    commands = 0.5 * np.sin(np.arange(50))
    one, two = (simulate(s, seeds=[4], duration=5.0, commands=commands) for s in calm)
    for name in one:
        # The failure cost is per unit of the uncontrolled motion, of which a calm has none.
        assert np.array_equal(one[name], two[name]), name


# The boom tip that runs --------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["random_phase", "shaping_filter"])
def test_a_running_boom_tip_has_the_variance_of_spectrum_times_response(kind):
    scenario = operation(kind=kind)
    grid = np.linspace(0.01, 6.0, 20_000)
    density = true_boom_tip_spectrum(grid, scenario.sea_state, CRANE)
    exact = math.sqrt(np.trapezoid(density, grid))
    of_rate = math.sqrt(np.trapezoid(grid**2 * density, grid))
    record = simulate(scenario, seeds=range(300), duration=20.0)
    # A narrow-banded motion of 300 seas over 20 s: standard error of a deviation about 2 %.
    assert record["boom_tip_heave"].std() == pytest.approx(exact, rel=0.06)
    assert record["boom_tip_heave_rate"].std() == pytest.approx(of_rate, rel=0.06)
    _, variance = boom_tip_lines(scenario.sea_state, CRANE)
    assert math.sqrt(variance.sum()) == pytest.approx(exact, rel=2e-3)
    assert scenario.boom_tip_scale == pytest.approx(exact, rel=2e-3)


def test_a_regular_boom_tip_has_the_table_s_amplitude():
    omega = 0.62
    sea = SeaState(kind="regular", significant_wave_height=2.0, peak_omega=omega)
    scenario = dataclasses.replace(operation(), sea_state=sea)
    heave = simulate(scenario, seeds=[1], duration=40.0)["boom_tip_heave"][:, 0]
    expected = abs(boom_tip_response(np.array([omega]), CRANE)[0])
    time = 0.1 * np.arange(len(heave))
    basis = np.column_stack([np.cos(omega * time), np.sin(omega * time)])
    assert np.hypot(*np.linalg.lstsq(basis, heave, rcond=None)[0]) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("heading", [0.0, 90.0, 150.0, 180.0])
def test_the_filter_fitted_to_spectrum_times_response_is_close(heading):
    vessel = dataclasses.replace(CRANE, heading=math.radians(heading))
    errors = boom_tip_fit(SEA, vessel, 8).errors
    print(f"heading {heading:g}: " + ", ".join(f"{k} {100 * v:.2f} %" for k, v in vars(errors).items()))
    assert abs(errors.variance) < 1e-6
    assert abs(errors.peak) < 0.01
    assert abs(errors.rate) < 0.01
    assert errors.misfit < 0.02


# The thesis's filter of a vessel -----------------------------------------------------------------


def test_a_second_order_filter_is_found_again_in_its_table(tmp_path):
    truth = Vessel(natural_omega=0.6, damping_ratio=0.3, gain=0.8)
    omega = np.linspace(0.05, 3.0, 300)
    path = write_table(tmp_path / "own.csv", {"heave": heave_response(omega, truth)}, omega)
    for sea in (None, SEA):
        found = fit_vessel(VesselTable(table=path), sea)
        assert found.natural_omega == pytest.approx(0.6, rel=0.01)
        assert found.damping_ratio == pytest.approx(0.3, rel=0.02)
        assert found.gain == pytest.approx(0.8, rel=0.01)


def test_a_filter_fitted_in_a_sea_has_the_boom_tip_s_variance_there():
    phases = dataclasses.replace(SEA, kind="random_phase")
    _, by_table = boom_tip_lines(phases, CRANE)
    _, by_filter = boom_tip_lines(phases, fit_vessel(CRANE, phases))
    assert by_filter.sum() == pytest.approx(by_table.sum(), rel=0.01)


# Nonsense ----------------------------------------------------------------------------------------

HEADER = "heading,omega," + ",".join(f"{m}_amplitude,{m}_phase" for m in MOTIONS)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("heading,omega\n0,1\n", "lacks the column 'heave_amplitude'"),
        (f"{HEADER}\n", "holds no responses"),
        (f"{HEADER}\n0,0.5,1,0,0,0,0,0\n0,1.0,nan,0,0,0,0,0\n", "line 3: heave_amplitude is 'nan'"),
        (f"{HEADER}\n0,0.5,1,0,0,0,0\n", "line 2: pitch_phase is ''"),
        (f"{HEADER}\n0,0.5,1,0,0,0,0,0\n0,1.0,-1,0,0,0,0,0\n", "line 3: heave_amplitude is negative"),
        (f"{HEADER}\n0,1.0,1,0,0,0,0,0\n0,0.5,1,0,0,0,0,0\n", "line 3: omega must increase within a heading"),
        (f"{HEADER}\n0,0.0,1,0,0,0,0,0\n0,0.5,1,0,0,0,0,0\n", "line 2: omega must be positive"),
        (f"{HEADER}\n0,0.5,1,0,0,0,0,0\n", "line 2: a heading needs at least two frequencies"),
        (
            f"{HEADER}\n0,0.5,1,0,0,0,0,0\n0,1,1,0,0,0,0,0\n1,0.5,1,0,0,0,0,0\n",
            "line 4: heading 1 has other frequencies than heading 0; fill the gap",
        ),
        (
            f"{HEADER}\n1,0.5,1,0,0,0,0,0\n1,1,1,0,0,0,0,0\n0,0.5,1,0,0,0,0,0\n0,1,1,0,0,0,0,0\n",
            "line 4: heading falls; sort",
        ),
    ],
)
def test_bad_tables_are_refused_in_a_sentence(tmp_path, text, complaint):
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=complaint) as caught:
        read_responses(path)
    assert "\n" not in str(caught.value)


def test_a_table_that_is_nowhere_is_named_with_those_that_are_shipped():
    with pytest.raises(
        ValueError, match=r"no file and no shipped table; did you mean 'construction_vessel'\?"
    ):
        responses_of(VesselTable(table="constructionvessel"))
    assert (SHIPPED / "construction_vessel.csv").is_file()


def test_headings_beyond_the_table_are_refused_and_those_around_the_circle_found():
    with pytest.raises(ValueError, match=r"heading -0\.5 rad lies outside 0 to 3\.14159 rad.*negate heading"):
        responses_of(CRANE).boom_tip(np.array([0.5]), -0.5, 0.0, 0.0)
    with pytest.raises(ValueError, match="lies outside"):
        boom_tip_response(np.array([0.5]), dataclasses.replace(CRANE, heading=1.5 * math.pi))
    around = dataclasses.replace(CRANE, heading=CRANE.heading + 2.0 * math.pi)
    omega = np.array([0.4, 0.8])
    assert boom_tip_response(omega, around) == pytest.approx(boom_tip_response(omega, CRANE))


def test_a_table_that_ends_before_the_motion_does_is_refused(tmp_path):
    omega = np.linspace(0.1, 0.8, 20)
    path = write_table(tmp_path / "short.csv", {"heave": np.ones(20)}, omega)
    short = VesselTable(table=path)
    for kind in ("random_phase", "shaping_filter"):
        with pytest.raises(
            ValueError, match=r"ends at 0\.8 rad/s, beyond which .* in this sea_state; extend"
        ):
            simulate(operation(short, kind=kind), seeds=[0], duration=1.0)
    regular = SeaState(kind="regular", significant_wave_height=1.0, peak_omega=1.0)
    with pytest.raises(ValueError, match=r"peak_omega 1 rad/s of a regular sea lies beyond 0\.8 rad/s"):
        boom_tip_components(regular, short)


def test_contradictions_name_both_keys():
    with pytest.raises(ValueError, match=r"vessel_table contradicts Scenario\.vessel"):
        dataclasses.replace(operation(), vessel=load("thesis_linear").vessel)
    with pytest.raises(ValueError, match=r"filter 'thesis' contradicts Scenario\.vessel_table"):
        operation(spectrum="bretschneider", filter="thesis")
    with pytest.raises(ValueError, match="vessel_table must be null when sea_state.kind is recorded"):
        operation(kind="recorded", recording="motion.csv")
    with pytest.raises(ValueError, match=r"VesselTable\.heading must be a finite number"):
        VesselTable(heading=math.nan)


# To and from YAML --------------------------------------------------------------------------------


def test_a_table_goes_to_yaml_and_back(tmp_path):
    scenario = operation()
    path = tmp_path / "mine.yaml"
    path.write_text(to_yaml(scenario), encoding="utf-8")
    assert read(path) == scenario
    assert read(path).fingerprint == scenario.fingerprint
    assert "# Where the waves travel to, from the bow" in path.read_text(encoding="utf-8")


def test_a_table_of_one_s_own_is_looked_up_beside_the_yaml_and_known_by_content(tmp_path):
    own = tmp_path / "ours.csv"
    own.write_bytes((SHIPPED / "construction_vessel.csv").read_bytes())
    mapping = to_mapping(operation())
    mapping["vessel_table"]["table"] = "ours.csv"
    path = tmp_path / "mine.yaml"
    path.write_text(to_yaml(from_mapping(mapping)), encoding="utf-8")
    found = read(path)
    assert found.vessel_table.table == str(own)
    assert found.fingerprint == operation().fingerprint
    assert with_value(found, "vessel_table.boom_tip_x", -29.0).fingerprint != found.fingerprint
