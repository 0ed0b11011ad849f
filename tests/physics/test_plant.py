"""The plant as a whole: signs, definitions of the channels, pay-out, slack, failure, resolution."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from heave_env.cable.axial import AxialSolver
from heave_env.cable.closed_form import payload_response
from heave_env.parameters import PayOut, SeaState
from heave_env.plant import Plant, simulate
from heave_env.scenarios import Scenario, load, names, with_value


def calm(scenario: Scenario) -> Scenario:
    return dataclasses.replace(scenario, sea_state=dataclasses.replace(scenario.sea_state, kind="calm"))


def test_kernel_is_the_axial_solver():
    # Same boom tip, same lengths, same steps: the environment's cable and the standalone one agree to the
    # rounding of summing the same numbers in another place.
    scenario = dataclasses.replace(load("sea_state_5"), n_substeps=1, n_iterations=2)
    rng = np.random.default_rng(0)
    record = simulate(scenario, seeds=[5], duration=30.0, commands=rng.uniform(-0.5, 0.5, 300))
    solver = AxialSolver(
        cable=scenario.cable, payload=scenario.payload, length=scenario.initial_length, n_iterations=2
    )
    alone = solver.simulate(record["boom_tip_heave"][:, 0], 0.1, record["length"][:, 0])
    # The solver measures from the static position at the present length: the definition's reference is
    # the length without the winch's share.
    reference = solver.static_stretch(900.0) - solver.static_stretch(record["length"][:, 0])
    heave = alone.payload_displacement + record["winch_displacement"][:, 0] + reference
    assert record["payload_heave"][:, 0] == pytest.approx(heave, abs=1e-9)
    assert record["sheave_tension"][:, 0] == pytest.approx(alone.sheave_tension, rel=1e-9)


def test_raising_command_raises_the_payload_by_as_much():
    scenario = calm(load("sea_state_5"))
    record = simulate(scenario, seeds=[0], duration=400.0, commands=np.full(4000, 0.5))
    assert record["winch_displacement"][-1, 0] == pytest.approx(0.5)
    assert record["length"][-1, 0] == pytest.approx(899.5)
    # The shorter cable stretches 0.5 m · (w2 + w1 L) / EA less, which raises the payload a trace more.
    trace = 0.5 * (50_000.0 + 54.0 * 900.0) / scenario.cable.axial_stiffness
    # Ten periods of the free vibration that the start left behind.
    assert record["payload_heave"][-1693:, 0].mean() == pytest.approx(0.5 + trace, abs=1e-3)


def test_perfect_compensation_leaves_the_payload_still(tmp_path):
    # Winch displacement against a slow boom tip: the payload's heave is their sum but for a trace.
    time = np.arange(0.0, 201.0, 0.5)
    motion = tmp_path / "slow.csv"
    rows = "\n".join(f"{t},{1.5 - 1.5 * np.cos(0.05 * t)}" for t in time)
    motion.write_text(f"time,heave\n{rows}\n")
    scenario = load("sea_state_5")
    slow = dataclasses.replace(
        scenario,
        sea_state=SeaState(kind="recorded", recording=str(motion)),
        vessel=None,
        duration=200.0,
        winch=dataclasses.replace(scenario.winch, command_delay=0.0, time_constant=0.01, command_range=8.0),
    )
    locked = simulate(slow, seeds=[0])
    record = simulate(slow, seeds=[0], commands=-locked["boom_tip_heave"][1:, 0])
    assert locked["payload_heave"].max() > 2.9
    assert np.abs(record["payload_heave"]).max() < 0.03


def test_calm_sea_keeps_everything_still():
    for name in names():
        scenario = calm(load(name))
        if scenario.pay_out.speed != 0.0:
            continue
        record = simulate(scenario, seeds=[0], duration=50.0)
        assert np.abs(record["payload_heave"]).max() < 1e-8
        if not scenario.is_linear:
            # Of the length that the episode drew, where it draws one.
            hanging = dataclasses.replace(scenario, length=float(record["length"][0, 0]), uncertainty=())
            assert record["sheave_tension"] == pytest.approx(hanging.static_tension, rel=1e-9)


def test_length_is_initial_length_and_payout_less_winch():
    scenario = load("lowering")
    rng = np.random.default_rng(1)
    record = simulate(scenario, seeds=[1, 2], duration=60.0, commands=rng.uniform(-1, 1, (600, 2)))
    assert record["length"] == pytest.approx(50.0 + record["payout"] - record["winch_displacement"], abs=1e-9)


def test_pay_out_ramps_runs_and_stops():
    scenario = with_value(calm(load("lowering")), "duration", 500.0)
    record = simulate(scenario, seeds=[0])
    payout, time = record["payout"][:, 0], record["time"]
    assert payout[time <= 20.0] == pytest.approx(0.0, abs=1e-9)
    # Ramped over 10 s, the speed of 2 m/s is reached at 30 s with half a ramp of cable out.
    assert payout[np.searchsorted(time, 30.0)] == pytest.approx(10.0, abs=0.02)
    assert np.diff(payout)[np.searchsorted(time, 100.0)] == pytest.approx(0.2, abs=1e-9)
    assert payout[-1] == pytest.approx(700.0)
    assert record["length"][-1, 0] == pytest.approx(750.0)


def test_payload_heave_is_measured_from_the_moving_still_water_position():
    # Lowered slowly without drag the payload stays at its static place below the lengthening cable.
    scenario = calm(load("lowering"))
    slow = dataclasses.replace(
        scenario,
        pay_out=PayOut(speed=0.5, start=5.0, distance=100.0, ramp=40.0),
        cable=dataclasses.replace(scenario.cable, tangential_drag_coefficient=0.0),
        payload=dataclasses.replace(scenario.payload, drag_area=0.0),
    )
    record = simulate(slow, seeds=[0])
    assert np.abs(record["payload_heave"]).max() < 5e-3


def test_steady_lowering_lifts_the_payload_by_its_drag():
    scenario = calm(load("lowering"))
    record = simulate(scenario, seeds=[0], duration=300.0)
    at = np.searchsorted(record["time"], 250.0)
    L = record["length"][at, 0]
    payload, cable = scenario.payload, scenario.cable
    drag = payload.drag_factor * 4.0 * L + 0.5 * cable.tangential_drag_per_length * 4.0 * L**2
    assert record["payload_heave"][at - 100 : at + 100, 0].mean() == pytest.approx(
        drag / cable.axial_stiffness, rel=0.02
    )


@pytest.mark.parametrize(("length", "drag_area"), [(900.0, 50.0), (60.0, 50.0)])
def test_uncontrolled_motion_is_that_of_linear_theory(length, drag_area):
    # Enough drag that 100 s forget the start from rest; stochastic linearisation is good to some per cent.
    scenario = with_value(load("sea_state_5"), "length", length)
    scenario = with_value(scenario, "payload.drag_area", drag_area)
    record = simulate(scenario, seeds=range(128))
    late = record["time"] > 100.0
    assert record["payload_heave"][late].std() == pytest.approx(scenario.uncontrolled_payload_std, rel=0.05)


def test_substeps_refine_the_same_sea():
    scenario = load("thesis_cable")
    coarse, fine = (
        simulate(dataclasses.replace(scenario, n_substeps=n), seeds=[4], duration=60.0) for n in (2, 16)
    )
    assert np.array_equal(coarse["boom_tip_heave"], fine["boom_tip_heave"])
    error = (coarse["payload_heave"] - fine["payload_heave"]).std()
    assert error < 1e-3 * fine["payload_heave"].std()


def test_documented_resolution_holds_the_deviation_to_a_thousandth():
    # 20 elements, 0.05 s against 60 elements, 0.00625 s, winch commands jumping every 0.1 s.
    rng = np.random.default_rng(2)
    commands = np.cumsum(rng.normal(0.0, 0.02, (1500, 4)), axis=0)
    deviations = []
    for n_elements, n_substeps in ((20, 2), (60, 16)):
        scenario = dataclasses.replace(load("sea_state_5"), n_elements=n_elements, n_substeps=n_substeps)
        record = simulate(scenario, seeds=range(4), duration=150.0, commands=commands)
        deviations.append(record["payload_heave"].std(axis=0))
    print(f"deviations {deviations[0] / deviations[1] - 1} from those of the refined run")
    assert deviations[0] == pytest.approx(deviations[1], rel=1e-3)


def test_float32_differs_by_less_than_the_discretisation():
    scenario = load("sea_state_5")
    results = {}
    for dtype, n_substeps in (("float64", 2), ("float32", 2), ("float64", 8)):
        plant = Plant(dataclasses.replace(scenario, n_substeps=n_substeps), 8, dtype=dtype)
        plant.begin(np.ones(8, dtype=bool), np.arange(8))
        heave = []
        for _ in range(1000):
            plant.advance(np.zeros(8))
            heave.append(plant.channels[:, 0].copy())
        results[dtype, n_substeps] = np.array(heave)
    rounding = np.abs(results["float32", 2] - results["float64", 2]).max()
    discretisation = np.abs(results["float64", 2] - results["float64", 8]).max()
    assert 0.0 < rounding < discretisation


@pytest.mark.parametrize("name", ["snap", "lowering", "deep_resonance"])
def test_tension_only_cable_never_pushes_and_survives_any_command(name):
    scenario = with_value(load(name), "cable.breaking_strength", None)
    rng = np.random.default_rng(3)
    n_steps = 600
    violent = np.sign(rng.normal(size=(n_steps, 16))) * scenario.winch.command_range
    record = simulate(scenario, seeds=range(16), duration=60.0, commands=violent)
    assert np.isfinite(record["payload_heave"]).all()
    assert record["tension_min"][1:].min() >= 0.0
    # Energy bounds the motion: it stays within a few times sheave and winch together.
    reach = 2.0 * scenario.winch.command_range + np.abs(record["boom_tip_heave"]).max()
    assert np.abs(record["payload_heave"]).max() < 5.0 * reach


def test_six_iterations_settle_the_slack_cable():
    scenario = load("snap")
    settled, more = (
        simulate(dataclasses.replace(scenario, n_iterations=n), seeds=[0, 1], duration=100.0) for n in (6, 20)
    )
    assert settled["slack"].mean() > 0.3
    difference = settled["payload_heave"] - more["payload_heave"]
    assert difference.std() < 5e-3 * more["payload_heave"].std()


def test_broken_cable_is_a_loss_that_costs_the_rest_of_the_episode():
    scenario = with_value(load("snap"), "cable.breaking_strength", 20_000.0)
    plant = Plant(scenario, 1)
    plant.begin(np.ones(1, dtype=bool), np.array([1]))
    while plant.outcome[0] == 0 and plant.steps()[0] < scenario.n_steps:
        plant.advance(np.zeros(1))
    assert plant.outcome[0] == 2
    remaining = scenario.n_steps - plant.steps()[0]
    charge = 10.0 * scenario.uncontrolled_cost * remaining
    assert plant.channel("failure_cost")[0] == pytest.approx(charge)
    assert plant.reward[0] == pytest.approx(
        -(charge + plant.channel("position_cost")[0] + plant.channel("command_cost")[0])
    )


def test_landing_ends_the_episode_without_a_charge():
    scenario = with_value(load("lowering"), "task.landing_depth", 120.0)
    plant = Plant(scenario, 1)
    plant.begin(np.ones(1, dtype=bool), np.array([1]))
    while plant.outcome[0] == 0:
        plant.advance(np.zeros(1))
    assert plant.outcome[0] == 3
    assert plant.channel("failure_cost")[0] == 0.0
    assert plant.channel("length")[0] == pytest.approx(120.0, abs=2.0)


def test_numerical_failure_ends_its_own_row_and_shows_no_nan():
    scenario = load("sea_state_5")
    plant, untouched = Plant(scenario, 4), Plant(scenario, 4)
    for one in (plant, untouched):
        one.begin(np.ones(4, dtype=bool), np.arange(4))
    state = plant.get_state()
    state["state"][0, -8:, 2] = np.nan  # the payload's node
    plant.set_state(state)
    for one in (plant, untouched):
        one.advance(np.zeros(4))
    assert plant.outcome.tolist() == [0, 0, 1, 0]
    assert np.isfinite(plant.observation).all() and np.isfinite(plant.reward).all()
    assert np.isfinite(plant.channels).all()
    others = [0, 1, 3]
    assert np.array_equal(plant.observation[others], untouched.observation[others])
    assert plant.reward[2] <= -10.0 * scenario.uncontrolled_cost * (scenario.n_steps - 1)


def test_winch_work_is_tension_times_speed():
    scenario = load("sea_state_5")
    record = simulate(scenario, seeds=[0], duration=100.0, commands=0.3 * np.sin(0.05 * np.arange(1000)))
    energy = 0.1 * record["winch_power"][1:, 0].sum()
    lifted = np.trapezoid(record["sheave_tension"][:, 0], record["winch_displacement"][:, 0])
    assert energy == pytest.approx(lifted, abs=0.02 * np.abs(record["winch_power"]).mean() * 100.0)


def test_payload_response_of_a_massless_cable_is_the_spring():
    snap = load("snap")
    spring = dataclasses.replace(snap.cable, mass_per_length=0.0, axial_damping=0.0)
    omega = np.array([0.5, 1.0, 3.0])
    k = spring.axial_stiffness / snap.length
    exact = 1.0 / (1.0 - snap.payload.inertia * omega**2 / k)
    assert payload_response(omega, spring, snap.payload, snap.length).real == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("name", ["thesis_regulator", "sea_state_5"])
def test_compensated_start_holds_the_payload_at_its_still_water_position(name):
    scenario = load(name)
    assert scenario.start == "compensated"
    start = {key: value[0] for key, value in simulate(scenario, seeds=range(50), duration=1.0).items()}
    assert start["winch_displacement"] == pytest.approx(-start["boom_tip_heave"], abs=1e-12)
    assert start["winch_rate"] == pytest.approx(-start["boom_tip_heave_rate"], abs=1e-12)
    # A cable longer or shorter by the winch's displacement stretches otherwise by a trace.
    assert np.abs(start["payload_heave"]).max() < 0.02 * np.abs(start["boom_tip_heave"]).max()


def test_hanging_start_moves_the_payload_with_the_boom_tip():
    scenario = with_value(load("sea_state_5"), "start", "hanging")
    start = {key: value[0] for key, value in simulate(scenario, seeds=range(50), duration=1.0).items()}
    assert start["payload_heave"] == pytest.approx(start["boom_tip_heave"], abs=1e-12)
    assert np.all(start["winch_displacement"] == 0.0)


def test_winch_that_was_compensating_goes_on_as_its_lag_says():
    # The pending commands are those that gave the winch its rate: with 0.2 s of delay nothing new
    # arrives before then.
    scenario = load("sea_state_5")
    record = simulate(scenario, seeds=[3], duration=1.0)
    u, rate = record["winch_displacement"][:3, 0], record["winch_rate"][0, 0]
    assert u == pytest.approx(u[0] + rate * (1.0 - np.exp(-0.1 * np.arange(3))), abs=1e-12)
