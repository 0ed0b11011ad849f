"""Ropes beyond Hooke's law: energy, statics, agreement with exact answers; the presets; who refuses them."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heave_env.cable import constitutive
from heave_env.cable.axial import AxialSolver
from heave_env.cable.closed_form import payload_response
from heave_env.cable.lowering import Lowering
from heave_env.cable.sagged_span import SaggedSpanSolver
from heave_env.cable.statics import StaticsSolver, Towed
from heave_env.cable.towing import Towing
from heave_env.cable.waves import WavesSolver, travel_times
from heave_env.parameters import Cable, Compensator, Draw, Line, Payload, PayOut, SeaState
from heave_env.plant import Plant, simulate
from heave_env.ropes import SLOW_LOAD, nylon_rope, polyester_rope, steel_wire_rope
from heave_env.scenarios import Scenario, from_mapping, load, read, to_mapping, to_yaml, with_value

WEIGHT = Payload(mass=20_000.0, submerged_weight=100_000.0)
BEYOND_HOOKE = {
    "quadratic_hardening": 19.5,
    "cubic_hardening": 253.5,
    "relaxing_stiffness": 3e6,
    "relaxation_time": 5.0,
}


def soft_rope(**changes: float) -> Cable:
    """A dragless rope that stretches by some 4 % under the weight."""
    base = Cable(
        mass_per_length=3.0, axial_stiffness=2e6, submerged_weight=5.0, diameter=0.08, tension_only=True
    )
    return dataclasses.replace(base, **changes)


def calm(scenario: Scenario) -> Scenario:
    return dataclasses.replace(scenario, sea_state=SeaState(kind="calm"))


strains = st.floats(-0.1, 0.2)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(old=strains, new=strains, k2=st.floats(0.0, 40.0), k3=st.floats(0.0, 400.0))
def test_mean_tension_is_the_change_of_energy_over_the_change_of_strain(old, new, k2, k3):
    rope = soft_rope(quadratic_hardening=k2, cubic_hardening=k3)
    numbers = (*constitutive.rope_energy_coefficients(rope), 0.0, 1.0, 0.0, 1.0, True)
    tension, slope, _ = constitutive.rope_tension(old, new, 0.0, rope.axial_stiffness, *numbers)
    energies = constitutive.stored_energy(rope, np.array([old, new]))
    assert tension * (new - old) == pytest.approx(energies[1] - energies[0], rel=1e-10, abs=1e-6)
    if abs(new - old) > 1e-3 and min(abs(old), abs(new)) > 1e-3:
        beyond, _, _ = constitutive.rope_tension(old, new + 1e-7, 0.0, rope.axial_stiffness, *numbers)
        assert slope == pytest.approx((beyond - tension) / 1e-7, rel=1e-3, abs=2.0)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    path=st.lists(st.floats(-0.05, 0.1), min_size=4, max_size=12),
    stiffness=st.floats(0.0, 1e7),
    relaxation_time=st.floats(0.01, 100.0),
    tension_only=st.booleans(),
)
def test_a_rope_gives_back_no_more_than_was_put_in(path, stiffness, relaxation_time, tension_only):
    # Whatever it is put through, slack and snap too, the work of each step is at least the energy gained;
    # and Newton's tangent is the tension's own slope, the branch's share included.
    hardening = {"quadratic_hardening": 20.0, "cubic_hardening": 300.0}
    rope = soft_rope(**hardening, relaxing_stiffness=stiffness, tension_only=tension_only)
    EA, law = rope.axial_stiffness, constitutive.rope_energy_coefficients(rope)
    share, held = 1.0 / (1.0 + 0.5 / relaxation_time), 0.0

    def pull(old, new):
        rest = (share, 0.0, 1.0, tension_only)
        return constitutive.rope_tension(old, new, held, EA, *law, stiffness, *rest)

    for old, new in itertools.pairwise(path):
        tension, slope, middle = pull(old, new)
        rest = (stiffness, share, tension_only)
        after = constitutive.branch_after(old, new, held, middle, EA, *law, *rest)
        gained = np.diff(constitutive.stored_energy(rope, np.array([old, new])))[0]
        gained += 0.5 * stiffness * (after**2 - held**2)
        assert tension * (new - old) >= gained - 1e-9 * EA
        if tension_only:
            assert tension >= 0.0
        beyond, before = pull(old, new + 1e-7)[0], pull(old, new - 1e-7)[0]
        if abs(new - old) > 1e-3 and abs(new) > 1e-6 and min(before, beyond) > 0.0 and tension > 0.0:
            assert slope == pytest.approx((beyond - before) / 2e-7, rel=1e-3, abs=1e3)
        held = after


@settings(max_examples=40, deadline=None, derandomize=True)
@given(tension=st.floats(-1e5, 1e6), k2=st.floats(-30.0, 30.0), k3=st.floats(301.0, 900.0))
def test_static_strain_inverts_static_tension(tension, k2, k3):
    rope = soft_rope(tension_only=False, quadratic_hardening=k2, cubic_hardening=k3)
    strain = constitutive.static_strain(rope, tension)
    assert constitutive.static_tension(rope, strain) == pytest.approx(tension, rel=1e-12, abs=1e-8)


def test_without_its_terms_the_rope_is_the_hookean_cable():
    # A vanishing k3 takes the other path through the solver: same answers but for rounding and settling.
    cable = load("lowering").cable
    heave = 0.8 * np.sin(0.05 * np.arange(800))
    length = 200.0 + 0.05 * np.arange(800)
    records = [
        AxialSolver(cable=made, payload=WEIGHT, length=200.0, n_elements=10).simulate(heave, 0.05, length)
        for made in (cable, dataclasses.replace(cable, cubic_hardening=1e-12))
    ]
    assert records[1].payload_displacement == pytest.approx(records[0].payload_displacement, abs=1e-8)
    assert records[1].tension_max == pytest.approx(records[0].tension_max, rel=1e-6)


def test_rope_hangs_still_at_its_nonlinear_stretch():
    rope = soft_rope(**BEYOND_HOOKE)
    solver = AxialSolver(cable=rope, payload=WEIGHT, length=500.0, n_elements=20)
    record = solver.simulate(np.zeros(400), 0.05)
    assert np.abs(record.payload_displacement).max() < 1e-9
    assert record.sheave_tension == pytest.approx(100_000.0 + 5.0 * 500.0, rel=1e-9)
    # The integral of strain over tension, finely.
    tension = 100_000.0 + 5.0 * np.linspace(0.0, 500.0, 2001)
    strain = constitutive.static_strain(rope, tension)
    exact = np.trapezoid(strain, dx=0.25)
    assert solver.static_stretch(500.0) == pytest.approx(exact, rel=1e-6)  # 20 midpoints
    hookean = 500.0 * (100_000.0 + 1250.0) / 2e6
    assert exact < 0.8 * hookean


@pytest.mark.parametrize("k2, k3", [(0.0, 0.0), (19.5, 253.5)])
def test_snapping_taut_neither_makes_nor_loses_energy(k2, k3):
    # A payload dropped onto a slack massless rope bounces for ever between the same heights.
    rope = soft_rope(
        mass_per_length=0.0, submerged_weight=0.0, quadratic_hardening=k2, cubic_hardening=k3
    ).in_air()
    solver = AxialSolver(cable=rope, payload=WEIGHT, length=100.0, n_elements=1)
    state = solver.rest()
    rest = solver.static_stretch(100.0)
    # Slacken: the sheave goes down by 8 m at once, and stays.
    record = solver.simulate(np.concatenate([[0.0], np.full(4000, -8.0)]), 0.02, start=state)
    assert record.slack_fraction > 0.2
    stretch = rest - record.payload_displacement + record.sheave_heave
    energy = (
        0.5 * WEIGHT.mass * record.payload_velocity**2
        + WEIGHT.submerged_weight * record.payload_displacement
        + 100.0 * constitutive.stored_energy(rope, stretch / 100.0)
    )[1:]
    assert np.ptp(energy) < 1e-7 * (energy.max() + 8.0 * WEIGHT.submerged_weight)


def test_peak_snap_converges_to_the_fine_grid():
    # The package of the scenario `snap` on nylon in place of wire, the sheave moving 7 ft at 4 s.
    scenario = load("snap")
    rope = dataclasses.replace(nylon_rope(0.016), submerged_weight=0.3)
    peaks = []
    for n_elements, dt in ((20, 0.02), (40, 0.01), (80, 0.005)):
        solver = AxialSolver(cable=rope, payload=scenario.payload, length=60.0, n_elements=n_elements)
        time = dt * np.arange(round(24.0 / dt) + 1)
        record = solver.simulate(2.134 * np.sin(0.5 * math.pi * time), dt)
        assert record.slack_fraction > 0.0
        peaks.append(record.tension_max.max())
    print(f"peak snap on nylon [N]: {peaks}")
    assert peaks == pytest.approx([peaks[2]] * 3, rel=2e-3)


@pytest.mark.parametrize("tension_only", [False, True])
@pytest.mark.parametrize("omega", [0.3, 1.0, 2.5])
def test_small_motion_meets_the_complex_modulus(omega, tension_only):
    # About the static tension the rope answers like a rod of dT/de + i ω EA1 τ / (1 + i ω τ), whether or not
    # it could push: no more than the tension between the waves goes through zero.
    rope = soft_rope(tension_only=tension_only, axial_damping=2e4, submerged_weight=0.0, **BEYOND_HOOKE)
    solver = AxialSolver(cable=rope, payload=WEIGHT, length=300.0, n_elements=20)
    period, dt = 2.0 * math.pi / omega, 0.01
    n_period = round(period / dt)
    dt = period / n_period
    time = dt * np.arange(n_period * round(300.0 / period) + 1)
    record = solver.simulate(1e-3 * np.sin(omega * time), dt)
    last = slice(-n_period, None)
    wave = np.exp(-1j * omega * time[last])
    measured = np.mean(record.payload_displacement[last] * wave) / np.mean(record.sheave_heave[last] * wave)
    exact = payload_response(np.array(omega), rope, WEIGHT, 300.0)
    assert abs(measured / exact - 1.0) < 2e-3  # 20 elements


def test_a_held_stretch_relaxes_in_its_time():
    # The sheave rises at once and stays; the surplus tension of a light rope dies as exp(-t/τ').
    rope = soft_rope(relaxing_stiffness=2e6, relaxation_time=5.0, mass_per_length=1e-3)
    rope = dataclasses.replace(rope, submerged_weight=0.0, axial_damping=1e5)
    heavy = dataclasses.replace(WEIGHT, mass=1e9, submerged_weight=100_000.0)
    solver = AxialSolver(cable=rope, payload=heavy, length=100.0, n_elements=1)
    record = solver.simulate(np.concatenate([[0.0], np.full(400, 1.0)]), 0.05)
    surplus = record.sheave_tension - 100_000.0 - 2e6 * 0.01
    assert surplus[2] == pytest.approx(2e6 * 0.01, rel=0.05)
    assert surplus[102] / surplus[2] == pytest.approx(math.exp(-1.0), rel=0.02)


def test_maxwell_branch_loses_what_the_closed_form_says():
    # Work of a slow cycle: π EA1 ωτ/(1 + ω²τ²) times the squared strain amplitude, per length.
    rope = soft_rope(relaxing_stiffness=2e6, relaxation_time=2.0, tension_only=False)
    third, quarter = constitutive.rope_energy_coefficients(rope)
    omega, per_cycle, held, work = 0.5, 1256, 0.0, 0.0
    dt = 2.0 * math.pi / omega / per_cycle
    share = 1.0 / (1.0 + 0.5 * dt / 2.0)
    strain = 0.05 + 0.01 * np.sin(omega * dt * np.arange(10 * per_cycle + 1))
    for k in range(len(strain) - 1):
        old, new = strain[k], strain[k + 1]
        numbers = (third, quarter, 2e6, share, 0.0, 1.0 / dt, False)
        tension, _, middle = constitutive.rope_tension(old, new, held, 2e6, *numbers)
        held = 2.0 * middle - held
        work += tension * (new - old) if k >= len(strain) - 1 - per_cycle else 0.0
    exact = math.pi * 2e6 * omega * 2.0 / (1.0 + (omega * 2.0) ** 2) * 0.01**2
    assert work == pytest.approx(exact, rel=2e-3)


# The environment ---------------------------------------------------------------------------------


def with_rope(scenario: Scenario, **changes: float) -> Scenario:
    return dataclasses.replace(scenario, cable=dataclasses.replace(scenario.cable, **changes))


def test_environment_is_the_axial_solver_on_such_a_rope():
    scenario = with_rope(load("sea_state_5"), **BEYOND_HOOKE, tension_only=True)
    scenario = dataclasses.replace(scenario, n_substeps=1, n_iterations=8)
    rng = np.random.default_rng(0)
    record = simulate(scenario, seeds=[5], duration=30.0, commands=rng.uniform(-0.5, 0.5, 300))
    solver = AxialSolver(cable=scenario.cable, payload=scenario.payload, length=900.0, n_iterations=8)
    alone = solver.simulate(record["boom_tip_heave"][:, 0], 0.1, record["length"][:, 0])
    reference = solver.static_stretch(900.0) - solver.static_stretch(record["length"][:, 0])
    heave = alone.payload_displacement + record["winch_displacement"][:, 0] + reference
    assert record["payload_heave"][:, 0] == pytest.approx(heave, abs=1e-7)
    assert record["sheave_tension"][:, 0] == pytest.approx(alone.sheave_tension, rel=1e-6)


@pytest.mark.parametrize("dtype, tolerance", [("float64", 1e-9), ("float32", 2e-3)])
def test_payload_heave_is_zero_at_rest(dtype, tolerance):
    scenario = calm(with_rope(load("deep_resonance"), **BEYOND_HOOKE))
    plant = Plant(scenario, 20, dtype=dtype)
    plant.begin(np.ones(20, dtype=bool), np.arange(20))
    for _ in range(50):
        assert np.abs(plant.channel("payload_heave")).max() < tolerance
        plant.advance(np.zeros(20))


def test_payload_heave_stays_zero_while_a_rope_is_paid_out_slowly():
    # The still-water reference follows the rope's own law: what is left is drag and the Maxwell branch's lag.
    slow = dataclasses.replace(load("lowering").pay_out, speed=0.05, distance=2.0, start=5.0)
    cable = dataclasses.replace(load("lowering").cable, axial_stiffness=2e6, **BEYOND_HOOKE)
    scenario = dataclasses.replace(calm(load("lowering")), pay_out=slow, cable=cable)
    heave = simulate(scenario, seeds=[0], duration=100.0)["payload_heave"][:, 0]
    assert abs(heave[-200:].mean()) < 2e-4
    assert scenario.static_stretch(52.0) < 0.9 * 52.0 * (35_000.0 + 26.0 * 54.0) / 2e6


def test_one_row_is_that_row_of_a_batch():
    scenario = with_rope(load("lowering"), **BEYOND_HOOKE)
    alone = simulate(scenario, seeds=[7], duration=40.0)
    batch = simulate(scenario, seeds=list(range(20)), duration=40.0)
    for name in ("payload_heave", "sheave_tension"):
        assert np.array_equal(alone[name][:, 0], batch[name][:, 7])


def test_gas_spring_and_rope_are_in_balance():
    # Without mass and damping the gas carries the sheave's tension at the middle of every solver step.
    rod = Compensator(gas_volume=2.0, piston_area=0.05, stroke=6.0)
    scenario = with_rope(load("lowering"), axial_stiffness=2e6, **BEYOND_HOOKE)
    scenario = dataclasses.replace(scenario, compensator=rod, pay_out=PayOut(), n_substeps=1, n_iterations=8)
    record = simulate(scenario, seeds=[2], duration=60.0)
    extension = record["compensator_displacement"][:, 0]
    middle = 0.5 * (extension[1:] + extension[:-1])
    gas = scenario.static_tension * (1.0 + middle / rod.gas_length) ** -rod.polytropic_exponent
    assert np.ptp(middle) > 0.01
    assert gas == pytest.approx(record["sheave_tension"][1:, 0], rel=1e-6)


@pytest.mark.parametrize("field", ["quadratic_hardening", "cubic_hardening", "relaxing_stiffness"])
def test_switching_a_term_on_changes_the_motion_and_not_the_sea(field):
    base = load("lowering")
    changed = with_rope(base, **{field: BEYOND_HOOKE[field]})
    a, b = (simulate(s, seeds=[3], duration=30.0) for s in (base, changed))
    for name in ("boom_tip_heave", "winch_displacement", "length", "payout"):
        assert np.array_equal(a[name], b[name])
    assert not np.allclose(a["payload_heave"], b["payload_heave"], atol=1e-6)


def test_drawn_hardening_is_each_rows_own():
    draw = Draw(parameter="cable.quadratic_hardening", low=0.0, high=40.0)
    scenario = dataclasses.replace(load("lowering"), uncertainty=(draw,), start="hanging")
    plant = Plant(calm(scenario), 4)
    plant.begin(np.ones(4, dtype=bool), np.arange(4))
    for _ in range(20):
        plant.advance(np.zeros(4))
    assert np.abs(plant.channel("payload_heave")).max() < 1e-9
    assert len(set(plant.drawn[:, 0])) == 4
    own = scenario.with_drawn({"cable.quadratic_hardening": float(plant.drawn[2, 0])})
    alone = simulate(own, seeds=[2], duration=20.0)["payload_heave"][:, 0]
    batch = simulate(scenario, seeds=[0, 1, 2, 3], duration=20.0)["payload_heave"][:, 2]
    assert batch == pytest.approx(alone, abs=1e-7)


def test_fingerprints_know_nothing_of_a_law_that_is_off():
    scenario = load("lowering")
    assert with_rope(scenario, relaxation_time=1.0).fingerprint == scenario.fingerprint
    assert with_rope(scenario, quadratic_hardening=2.0).fingerprint != scenario.fingerprint
    older = to_mapping(scenario)
    for key in BEYOND_HOOKE:
        older["cable"].pop(key)
    assert from_mapping(older).fingerprint == scenario.fingerprint


def test_rope_survives_yaml(tmp_path):
    scenario = with_value(load("lowering"), "cable.cubic_hardening", 253.5)
    path = tmp_path / "rope.yaml"
    path.write_text(to_yaml(scenario), encoding="utf-8")
    assert read(path) == scenario


# Presets and bad input ---------------------------------------------------------------------------


@pytest.mark.parametrize("make, slow", [(polyester_rope, 14.0), (nylon_rope, 5.0)])
def test_fibre_rope_has_the_published_stiffnesses(make, slow):
    rope = make(0.1)
    strength = rope.breaking_strength
    stretched = constitutive.static_strain(rope, SLOW_LOAD * strength)
    assert stretched == pytest.approx(SLOW_LOAD / slow, rel=5e-3)  # nylon's has no branch to mend it
    fast, growth = {"polyester_rope": (11.6, 40.0), "nylon_rope": (2.08, 39.0)}[make.__name__]
    for load_share in (0.1, 0.2, 0.3):
        modulus = constitutive.dynamic_modulus(rope, 0.8, load_share * strength)
        # The branch lets a steady load stretch the rope farther than a fast one, to where it is stiffer.
        published = (fast + growth * load_share) * strength
        print(f"{make.__name__} at {load_share:g}: {modulus.real / published:.3f} of the published stiffness")
        assert modulus.real == pytest.approx(published, rel=0.06)


def test_wire_rope_of_the_crane_trade():
    rope = steel_wire_rope(0.036)
    assert rope.is_hookean
    assert rope.breaking_strength == pytest.approx(904e3, rel=0.01)  # EN 12385-4, 36 mm, 6x36 IWRC, 1960
    assert rope.mass_per_length == pytest.approx(5.30, rel=0.01)
    assert steel_wire_rope(0.036, 850e3).breaking_strength == 850e3


@pytest.mark.parametrize("make", [steel_wire_rope, polyester_rope, nylon_rope])
@pytest.mark.parametrize("diameter", [0.0, -0.1, math.nan])
def test_a_rope_without_thickness_is_refused(make, diameter):
    with pytest.raises(ValueError, match=r"Cable\.\w+ must be a (positive )?number"):
        make(diameter)


@pytest.mark.parametrize(
    "changes",
    [
        {"quadratic_hardening": -1.0},
        {"quadratic_hardening": -20.0, "cubic_hardening": 100.0},
        {"quadratic_hardening": 20.0, "cubic_hardening": 100.0, "tension_only": False},
    ],
)
def test_a_law_that_softens_to_nothing_is_refused(changes):
    with pytest.raises(ValueError, match=r"Cable\.quadratic_hardening must be below sqrt\(3 cubic_ha"):
        soft_rope(**changes)


@pytest.mark.parametrize("field", ["cubic_hardening", "relaxing_stiffness", "relaxation_time"])
def test_negative_terms_are_refused(field):
    with pytest.raises(ValueError, match=rf"Cable\.{field} must be a"):
        soft_rope(**{field: -1.0})


@pytest.mark.parametrize("field", ["quadratic_hardening", "relaxing_stiffness"])
def test_other_solvers_refuse_such_a_rope(field):
    rope = soft_rope(**{field: 3.0})
    shape = StaticsSolver(line=Line.uniform(rope, 100.0), ends=Towed(payload=WEIGHT)).solve()
    for build in (
        lambda: WavesSolver(shape=shape),
        lambda: travel_times(shape),
        lambda: SaggedSpanSolver(cable=rope, length=110.0, span=100.0),
        lambda: Lowering(cable=rope, payload=WEIGHT),
        lambda: Towing(cable=rope, length=100.0, speed=1.0),
    ):
        with pytest.raises(ValueError, match=rf"Cable\.{field} must be 0 here, got 3\.0"):
            build()
