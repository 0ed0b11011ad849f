"""The axial cable against closed forms, its own order, conservation and published numbers."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from heave_env.cable.axial import AxialSolver
from heave_env.cable.closed_form import natural_omegas, payload_response
from heave_env.parameters import Cable, Payload
from heave_env.scenarios import circular_section, load

DOCUMENTED_DT = 0.05
FOOT, POUND_FORCE, SLUG = 0.3048, 4.4482216152605, 14.59390294


def fitted(signal: np.ndarray, time: np.ndarray, omegas: list[float]) -> tuple[np.ndarray, float]:
    """Sine and cosine amplitudes of a signal at given frequencies, and the squared misfit."""
    basis = np.concatenate([[np.sin(w * time), np.cos(w * time)] for w in omegas] + [[np.ones_like(time)]]).T
    coefficients, misfit, *_ = np.linalg.lstsq(basis, signal, rcond=None)
    return coefficients, float(misfit[0])


def forced_and_natural(solver: AxialSolver, omega: float, dt: float) -> tuple[float, float]:
    """Payload amplitude at the frequency of the sheave, and the natural frequency beside it.

    From rest under sin ωt the payload moves with both; without drag neither dies, and both are read
    off by least squares.
    """
    time = dt * np.arange(round(400.0 / dt))
    payload = solver.simulate(np.sin(omega * time), dt).payload_displacement
    best = minimize_scalar(
        lambda natural: fitted(payload, time, [omega, natural])[1],
        bounds=(0.36, 0.38),
        method="bounded",
        options={"xatol": 1e-9},
    )
    return float(fitted(payload, time, [omega, best.x])[0][0]), float(best.x)


@pytest.mark.parametrize("omega", [0.3, 0.5, 0.8, 1.3])
def test_payload_amplitude_is_the_closed_form_at_the_documented_resolution(dragless_solver, omega):
    amplitude, natural = forced_and_natural(dragless_solver, omega, DOCUMENTED_DT)
    cable, payload = dragless_solver.cable, dragless_solver.payload
    exact = payload_response(np.array(omega), cable, payload, 900.0).real
    first = natural_omegas(cable, payload, 900.0, 1)[0]
    print(
        f"{omega} rad/s: amplitude {amplitude / exact - 1:+.3%}, natural frequency {natural / first - 1:+.4%}"
    )
    assert amplitude == pytest.approx(float(exact), rel=1e-3)
    assert natural == pytest.approx(first, rel=1e-3)


def test_natural_frequencies_are_the_published_ones(dragless):
    # The cable of H 6.2.6, tests/reference/SOURCES.md: 0.3712 and 5.193 rad/s.
    assert natural_omegas(*dragless, 900.0, 2) == pytest.approx([0.3712, 5.193], rel=1.5e-4)


@pytest.mark.parametrize(("n_elements", "dt", "tolerance"), [(20, 0.05, 1e-2), (60, 0.0125, 1e-3)])
def test_second_natural_frequency(dragless, n_elements, dt, tolerance):
    cable, payload = dragless
    solver = AxialSolver(cable=cable, payload=payload, length=900.0, n_elements=n_elements)
    time = dt * np.arange(round(80.0 / dt))
    push = np.where(time < 0.6, np.sin(np.pi * time / 0.6) ** 2, 0.0)
    record = solver.simulate(0.1 * push, dt)
    free = time > 1.0
    exact = natural_omegas(cable, payload, 900.0, 3)
    best = minimize_scalar(
        lambda w: fitted(record.sheave_tension[free], time[free], [exact[0], w, exact[2]])[1],
        bounds=(5.0, 5.4),
        method="bounded",
        options={"xatol": 1e-9},
    )
    print(f"{n_elements} elements, {dt} s: second natural frequency {best.x / exact[1] - 1:+.3%}")
    assert best.x == pytest.approx(exact[1], rel=tolerance)


def payload_after_a_push(solver: AxialSolver, dt: float) -> float:
    time = dt * np.arange(round(6.0 / dt) + 1)
    return float(solver.simulate(np.sin(0.5 * time) ** 4, dt).payload_displacement[-1])


def observed_order(results: list[float]) -> float:
    """Mean order over successive halvings of the step."""
    changes = np.abs(np.diff(results))
    return float(np.log2(changes[0] / changes[-1]) / (len(changes) - 1))


def test_second_order_in_time(thesis_cable):
    solver = AxialSolver(cable=thesis_cable.cable, payload=thesis_cable.payload, length=900.0, n_iterations=1)
    results = [payload_after_a_push(solver, dt) for dt in (0.1, 0.05, 0.025, 0.0125)]
    assert observed_order(results) == pytest.approx(2.0, abs=0.1)


def test_second_order_in_space(thesis_cable):
    cable, payload = thesis_cable.cable, thesis_cable.payload
    results = [
        payload_after_a_push(AxialSolver(cable=cable, payload=payload, length=900.0, n_elements=n), 0.01)
        for n in (5, 10, 20, 40)
    ]
    assert observed_order(results) == pytest.approx(2.0, abs=0.1)


def test_second_order_in_time_while_length_changes_in_kinks(dragless):
    # Pay-out whose rate jumps every second, as under a stepped winch command: L'' is impulsive. The kinks
    # ring the grid's own modes, so single halvings scatter; the mean order over three does not.
    cable, payload = dragless
    solver = AxialSolver(cable=cable, payload=payload, length=300.0, n_elements=10)

    def payload_at_the_end(dt: float) -> float:
        time = dt * np.arange(round(8.0 / dt) + 1)
        kinks = np.interp(time, np.arange(9.0), 300.0 + np.array([0, 0.5, 0.2, 1.4, 1.5, 0.3, 0.9, 2.0, 1.0]))
        return float(solver.simulate(0.0 * time, dt, kinks).payload_displacement[-1])

    assert observed_order([payload_at_the_end(dt) for dt in (0.02, 0.01, 0.005, 0.0025, 0.00125)]) > 1.8


def test_drag_free_pay_out_follows_the_adiabatic_growth():
    # Example Five's cable, 54 to 497 m at 1 m/s: action E/ω is conserved, amplitude^4 ~ 1 / (k M'). The
    # reference computation grew 0.74 to 1.25 m, a factor 1.69; the printed equations give 14.
    cable = Cable(
        mass_per_length=7.2,
        axial_stiffness=9.05e9 * circular_section(0.047),
        submerged_weight=54.0,
        diameter=0.047,
    )
    payload = Payload(mass=5000.0, added_mass=8000.0, submerged_weight=35_000.0)
    solver = AxialSolver(cable=cable, payload=payload, length=50.0)
    dt = 0.01
    time = dt * np.arange(round(460.0 / dt))
    length = 50.0 + time
    motion = solver.simulate(0.0 * time, dt, length).payload_displacement

    def amplitude(around: float) -> float:
        k = cable.axial_stiffness / around
        period = 2.0 * math.pi * math.sqrt(payload.inertia / k)
        near = np.abs(length - around) < 0.75 * period
        return float(np.ptp(motion[near]) / 2.0)

    def softness(L: float) -> float:
        return L / (payload.inertia + cable.mass_per_length * L / 3.0)

    growth = amplitude(497.0) / amplitude(54.0)
    print(f"growth {growth:.3f}")
    assert growth == pytest.approx((softness(497.0) / softness(54.0)) ** 0.25, rel=0.02)
    assert growth == pytest.approx(1.25 / 0.74, rel=0.02)


def test_energy_is_kept_without_drag(dragless):
    # Free vibration after a push: the midpoint rule conserves the energy of a linear chain exactly.
    cable, payload = dragless
    solver = AxialSolver(cable=cable, payload=payload, length=900.0)
    dt = 0.05
    time = dt * np.arange(6000)
    motion = solver.simulate(
        np.where(time < 8.0, 0.5 * np.sin(np.pi * time / 8.0), 0.0), dt
    ).payload_displacement
    early, late = motion[(time > 10) & (time < 60)], motion[(time > 250) & (time < 300)]
    assert np.ptp(late) == pytest.approx(np.ptp(early), rel=2e-3)


def test_hanging_cable_stays_still(thesis_cable):
    solver = AxialSolver(cable=thesis_cable.cable, payload=thesis_cable.payload, length=900.0)
    record = solver.simulate(np.zeros(400), 0.05)
    assert np.abs(record.payload_displacement).max() < 1e-9
    assert record.sheave_tension == pytest.approx(50_000.0 + 54.0 * 900.0, rel=1e-9)
    assert record.payload_tension == pytest.approx(50_000.0, rel=1e-9)


def test_steps_taken_singly_are_the_march(thesis_cable):
    solver = AxialSolver(cable=thesis_cable.cable, payload=thesis_cable.payload, length=900.0)
    heave = 0.3 * np.sin(0.6 * 0.05 * np.arange(50))
    length = 900.0 + 0.02 * np.arange(50)
    record = solver.simulate(heave, 0.05, length)
    state = solver.rest()
    for k in range(1, 50):
        state = solver.step(state, (heave[k], length[k]), 0.05)
        assert solver.payload_motion(state)[0] == record.payload_displacement[k]
        assert solver.top_tension(state) == record.sheave_tension[k]


def berteaux_extremes(n_elements: int, cable: Cable, dt: float) -> tuple[float, float, float, float]:
    """Steady extremes of Berteaux's example 9.5: payload [ft] and tension [lb]."""
    payload = Payload(
        mass=130.5 * SLUG,
        added_mass=12.0 * SLUG,
        submerged_weight=2000.0 * POUND_FORCE,
        drag_area=3.14 * FOOT**2,
    )
    solver = AxialSolver(
        cable=cable, payload=payload, length=3000.0 * FOOT, n_elements=n_elements, n_iterations=8
    )
    time = dt * np.arange(round(160.0 / dt))
    record = solver.simulate(7.0 * FOOT * np.sin(0.5 * np.pi * time), dt)
    steady = time > 100.0
    position, tension = (
        record.payload_displacement[steady] / FOOT,
        record.sheave_tension[steady] / POUND_FORCE,
    )
    print(
        f"{n_elements} elements, {dt} s: payload {position.min():.2f} to {position.max():.2f} ft, tension "
        f"{tension.min():.0f} to {tension.max():.0f} lb"
    )
    return float(position.min()), float(position.max()), float(tension.min()), float(tension.max())


def test_berteaux_example_as_a_massless_spring():
    spring = Cable(
        mass_per_length=0.0,
        axial_stiffness=1.8e6 * POUND_FORCE,
        submerged_weight=0.0,
        diameter=0.375 * FOOT / 12.0,
        tension_only=True,
    )
    lowest, highest, slackest, peak = berteaux_extremes(1, spring, 0.005)
    assert lowest == pytest.approx(-4.0, rel=0.01)
    assert highest == pytest.approx(16.1, rel=0.01)
    assert peak == pytest.approx(8320.0, rel=0.01)
    assert slackest == 0.0


def test_berteaux_example_with_the_cables_own_mass_moves_less_and_pulls_more():
    # No published figure: 20 elements against 40 at half the step; -4.1 to +15.6 ft and 9400 lb.
    cable = load("snap").cable
    coarse, fine = berteaux_extremes(20, cable, 0.01), berteaux_extremes(40, cable, 0.005)
    assert coarse[:2] == pytest.approx(fine[:2], rel=0.01)
    assert coarse[3] == pytest.approx(fine[3], rel=0.02)
    assert fine[1] < 16.1 and fine[3] > 8320.0


def test_tension_only_changes_nothing_while_the_cable_is_taut(thesis_cable):
    heave = 0.2 * np.sin(0.7 * 0.05 * np.arange(1000))
    records = [
        AxialSolver(
            cable=dataclasses.replace(thesis_cable.cable, tension_only=tension_only),
            payload=thesis_cable.payload,
            length=900.0,
        ).simulate(heave, 0.05)
        for tension_only in (False, True)
    ]
    assert records[0].payload_tension.min() > 0.0
    assert records[1].payload_displacement == pytest.approx(records[0].payload_displacement, abs=1e-9)


def test_kelvin_damping_damps_as_its_closed_form(dragless):
    # C_A = EA τ: a mode decays at the rate ω² τ / 2.
    cable, payload = dragless
    tau = 0.02
    damped = dataclasses.replace(cable, axial_damping=cable.axial_stiffness * tau)
    motion = [
        AxialSolver(cable=one, payload=payload, length=900.0).simulate(
            np.where(np.arange(4000) < 160, 0.5 * np.sin(np.pi * np.arange(4000) / 160), 0.0), 0.05
        )
        for one in (cable, damped)
    ]
    ends = [np.ptp(record.payload_displacement[-700:]) for record in motion]
    omega = natural_omegas(cable, payload, 900.0, 1)[0]
    assert np.log(ends[0] / ends[1]) == pytest.approx(0.5 * omega**2 * tau * 180.0, rel=0.06)
