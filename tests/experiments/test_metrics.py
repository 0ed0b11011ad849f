"""Metrics of series whose answers are known."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from experiments.metrics import (
    METRICS,
    mean_cost,
    metric_names,
    paired_difference,
    scores,
    spectrum,
    summary,
    touch_down_speed,
    window,
)
from experiments.report import cable_table
from experiments.rollout import rollout
from heave_env.controller import NoControl
from heave_env.scenarios import load
from tests.experiments.stored import DT, trajectory

N_STEPS = 4000
TIME = np.arange(N_STEPS + 1)[:, None] * DT
WHOLE = 2.0 * math.pi / 10.0  # a period of 10 s: the scored 300 s hold whole ones


def test_the_protocol_leaves_out_100_s_and_scores_300_s():
    part = window(400.0, DT)
    assert (part.warm_up, part.scored, part.is_shortened) == (100.0, 300.0, False)
    assert (window(1000.0, DT).warm_up, window(1000.0, DT).scored) == (100.0, 300.0)


def test_a_short_episode_keeps_a_quarter_for_the_warm_up():
    part = window(40.0, DT)
    assert (part.warm_up, part.scored, part.is_shortened) == (10.0, 30.0, True)


@pytest.mark.parametrize("warm_up", [-1.0, 40.0, math.nan])
def test_a_warm_up_that_leaves_nothing_is_refused(warm_up):
    with pytest.raises(ValueError, match="warm-up"):
        window(40.0, DT, warm_up)


def test_scores_of_sinusoids_are_the_closed_forms():
    heave = 0.3 * np.sin(WHOLE * TIME) + 0.1
    boom_tip = 0.6 * np.sin(WHOLE * TIME)
    command = np.broadcast_to(0.2 * np.cos(WHOLE * TIME[:-1]), (N_STEPS, 1)).copy()
    run = trajectory(heave, boom_tip, command, position_weight=2.0, command_weight=3.0)
    locked = trajectory(1.2 * np.sin(WHOLE * TIME), boom_tip)
    found = scores(run, window(400.0, DT), locked)
    root = math.sqrt(0.5)
    assert found["payload_heave_std"] == pytest.approx(0.3 * root)
    assert found["payload_heave_rms"] == pytest.approx(math.sqrt(0.045 + 0.01))
    assert found["payload_heave_max"] == pytest.approx(0.4)
    assert found["efficiency_boom_tip"] == pytest.approx(0.5)
    assert found["efficiency_locked_winch"] == pytest.approx(0.75)
    assert found["control_energy"] == pytest.approx(0.02)
    assert found["command_std"] == pytest.approx(0.2 * root)
    assert found["position_cost"] == pytest.approx(2.0 * 0.055)
    assert found["command_cost"] == pytest.approx(3.0 * 0.02)
    assert found["cost"] == pytest.approx(2.0 * 0.055 + 3.0 * 0.02)
    assert set(found) == {name for name, metric in METRICS.items() if not (metric.priced or metric.oracle)}


def test_the_warm_up_does_not_count():
    heave = np.where(TIME > 100.0, 0.0, 5.0) * np.sin(WHOLE * TIME)
    found = scores(trajectory(heave), window(400.0, DT))
    assert found["payload_heave_std"] == 0.0
    assert found["cost"] == 0.0


def test_a_step_is_scored_with_the_heave_it_ends_at():
    heave = np.zeros((N_STEPS + 1, 1))
    heave[1000] = 7.0  # t = 100 s: where the warm-up's last step ends
    assert scores(trajectory(heave), window(400.0, DT))["payload_heave_max"] == 0.0
    heave[4000] = 3.0
    assert scores(trajectory(heave), window(400.0, DT))["payload_heave_max"] == 3.0


def test_work_counts_only_lifting_and_power_is_its_peak():
    run = trajectory(np.zeros((N_STEPS + 1, 1)))
    power = np.where(np.arange(N_STEPS) % 2 == 0, 500.0, -900.0)[:, None]
    run.steps["winch_power"] = power
    run.steps["supply_power"] = 2.0 * power
    found = scores(run, window(400.0, DT))
    assert found["winch_work"] == pytest.approx(500.0 * 150.0)
    assert found["supply_energy"] == pytest.approx((1000.0 - 1800.0) * 150.0 / 3.6e6)
    assert found["winch_power_peak"] == pytest.approx(500.0)


def test_tension_and_shares_are_taken_over_the_scored_steps():
    run = trajectory(np.zeros((N_STEPS + 1, 2)))
    slack = np.zeros((N_STEPS, 2))
    slack[:1000] = 1.0
    slack[1000:2500, 1] = 1.0
    peak = np.full((N_STEPS, 2), 1e5)
    peak[500], peak[3999, 1] = 9e5, 2e5
    run.steps.update(slack=slack, tension_max=peak)
    found = scores(run, window(400.0, DT))
    assert found["slack_fraction"] == pytest.approx([0.0, 0.5])
    assert found["tension_peak"] == pytest.approx([1e5, 2e5])
    assert found["tension_min"] == pytest.approx([9e4, 9e4])


def test_the_rare_tension_is_that_which_one_step_in_a_thousand_exceeds():
    """Of 3000 scored steps three exceed it; a sea that ended before the scoring began has none."""
    run = trajectory(np.zeros((N_STEPS + 1, 2)))
    peak = np.tile(np.arange(N_STEPS, dtype=float)[::-1, None], (1, 2))
    run.steps.update(tension_max=peak)
    run.n_valid[1] = 500
    found = scores(run, window(400.0, DT))
    assert (peak[1000:, 0] > found["tension_p999"][0]).sum() == 3
    assert found["tension_p999"][0] < found["tension_peak"][0] and np.isnan(found["tension_p999"][1])


def test_a_plant_without_a_cable_has_no_tension_metrics():
    found = scores(trajectory(np.zeros((N_STEPS + 1, 1)), cable=False), window(400.0, DT))
    missing = {name for name in METRICS if name not in found}
    assert missing == {name for name, m in METRICS.items() if m.cable or m.priced or m.oracle}


def test_touch_down_speed_is_the_pay_out_less_the_rate_of_heave():
    run = trajectory(np.zeros((N_STEPS + 1, 3)), n_valid=np.array([2000, 2500, N_STEPS]))
    paid_out = 0.15 * TIME
    lifted = np.broadcast_to(0.4 * np.sin(TIME), run.states["length"].shape)
    rate = np.zeros_like(lifted)
    rate[2000, 0], rate[2500, 1] = -0.2, 0.05
    states = run.states | {
        "length": 280.0 + paid_out - lifted,
        "winch_displacement": lifted,
        "payload_heave_rate": rate,
    }
    landed = {"landed": np.array([True, True, False])}
    run = dataclasses.replace(run, states=states, outcomes=landed)
    found = scores(run, window(400.0, DT))["touch_down_speed"]
    assert found[:2] == pytest.approx([0.35, 0.10])
    assert np.isnan(found[2])


def test_touch_down_speed_is_that_of_the_plant():
    scenario = load("landing")
    run = rollout(scenario, NoControl(), range(6))
    assert run.outcomes["landed"].all()
    for sea in range(6):
        last = run.n_valid[sea]
        paid_out = run.states["length"][:, sea] + run.states["winch_displacement"][:, sea]
        stretch = [scenario.static_stretch(length) for length in paid_out[last - 1 : last + 1]]
        depth = (
            paid_out[last - 1 : last + 1] + stretch - run.states["payload_heave"][last - 1 : last + 1, sea]
        )
        assert depth[0] < 300.0 <= depth[1]
        # The mean speed over the step, where the metric has that at its end, without the stretch.
        assert touch_down_speed(run)[sea] == pytest.approx(np.diff(depth)[0] / DT, abs=0.01)


def test_only_an_operation_that_is_to_land_has_a_touch_down_speed():
    names = {name: set(metric_names(load(name))) for name in ("landing", "lowering", "thesis_linear")}
    assert names["landing"] == {name for name, m in METRICS.items() if not (m.priced or m.oracle)}
    assert names["landing"] - names["lowering"] == {"touch_down_speed"}
    assert names["lowering"] - names["thesis_linear"] == {
        name for name, metric in METRICS.items() if metric.cable and not metric.landing
    }


def test_a_report_shows_touch_down_where_a_payload_is_to_land():
    names = ("winch_work", "winch_power_peak", "tension_peak", "tension_min", "slack_fraction", "safety_cost")
    metrics = {name: {"mean": 1.0, "maximum": 1.0} for name in names}
    metrics["touch_down_speed"] = {"mean": 0.149, "low": 0.146, "high": 0.152}
    columns, rows = cable_table({"lqg": {"metrics": metrics}})
    assert columns[-1][0] == "touch-down [m/s]"
    assert rows[0][-1] == "0.1490 ± 0.0030"
    metrics.pop("touch_down_speed")
    columns, rows = cable_table({"lqg": {"metrics": metrics}})
    assert columns[-1][0] == "unsafe"
    assert len(columns) == len(rows[0])


def test_the_locked_winch_must_have_met_the_same_seas():
    run = trajectory(np.zeros((N_STEPS + 1, 2)))
    with pytest.raises(ValueError, match="same seas"):
        scores(run, window(400.0, DT), dataclasses.replace(run, seeds=(1, 2)))


# Failures ----------------------------------------------------------------------------------------


def failing(at: int, charge_per_step: float = 10.0):
    """A sea that costs 2 per step until it diverges in step `at`, which charges for all that is left."""
    run = trajectory(np.ones((N_STEPS + 1, 1)), n_valid=np.array([at]))
    run.steps["failure_cost"][at] = charge_per_step * (N_STEPS - at)
    run.outcomes["diverged"][:] = True
    return run


@pytest.mark.parametrize(("at", "expected"), [(2500, 6.0), (500, 10.0), (1000, 10.0)])
def test_a_failure_is_charged_for_the_scored_steps_it_forfeits(at, expected):
    assert mean_cost(failing(at), window(400.0, DT)) == pytest.approx(expected)


def test_failing_early_never_pays():
    part = window(400.0, DT)
    costs = [float(mean_cost(failing(at), part)[0]) for at in (10, 900, 1500, 3000, 3999)]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] > float(mean_cost(trajectory(np.ones((N_STEPS + 1, 1))), part)[0])


def test_a_failure_in_the_last_step_is_charged_there():
    run = trajectory(np.ones((N_STEPS + 1, 1)))  # lost in its last step: every step is valid
    run.steps["failure_cost"][-1] = 30.0
    assert mean_cost(run, window(400.0, DT)) == pytest.approx(2.0 + 30.0 / 3000)


def test_a_sea_that_ended_before_the_scoring_has_no_motion_but_a_cost():
    found = scores(failing(500), window(400.0, DT))
    assert math.isnan(found["payload_heave_std"][0])
    assert math.isfinite(found["cost"][0])


def test_a_landing_is_averaged_over_the_steps_it_had():
    run = trajectory(np.ones((N_STEPS + 1, 1)), n_valid=np.array([2000]))
    assert mean_cost(run, window(400.0, DT)) == pytest.approx(2.0)


# Over seas ---------------------------------------------------------------------------------------


def test_the_interval_is_students_t():
    # n = 5, mean 3, s = sqrt(2.5): 2.776445 s / sqrt(5) = 1.963243 (t table, 4 degrees of freedom)
    found = summary(np.array([1.0, 2.0, 3.0, 4.0, 5.0]))
    assert (found.mean, found.median, found.maximum, found.n_seas) == (3.0, 3.0, 5.0, 5)
    assert found.high - found.mean == pytest.approx(1.963243, rel=1e-6)
    assert found.mean - found.low == pytest.approx(1.963243, rel=1e-6)


def test_the_interval_holds_the_mean_nineteen_times_in_twenty():
    rng = np.random.default_rng(1)
    held = [s.low <= 0.0 <= s.high for s in (summary(rng.standard_normal(8)) for _ in range(2000))]
    assert np.mean(held) == pytest.approx(0.95, abs=0.015)  # three standard errors of 2000 trials


def test_seas_without_a_score_are_left_out_and_counted():
    found = summary(np.array([1.0, np.nan, 3.0]))
    assert (found.mean, found.n_seas) == (2.0, 2)
    assert summary(np.array([np.nan])).n_seas == 0
    assert math.isnan(summary(np.array([2.0])).low)


def test_paired_differences_are_sharper_than_the_seas_differ():
    rng = np.random.default_rng(2)
    sea = rng.uniform(1.0, 9.0, 20)
    found = paired_difference(sea + 0.1 + 1e-3 * rng.standard_normal(20), sea)
    assert found.mean == pytest.approx(0.1, abs=1e-3)
    assert found.high - found.low < 2e-3


def test_the_spectrum_integrates_to_the_variance():
    rng = np.random.default_rng(3)
    heave = 0.2 * rng.standard_normal((N_STEPS + 1, 16))
    omega, density = spectrum(trajectory(heave), window(400.0, DT), "payload_heave")
    assert np.trapezoid(density, omega) == pytest.approx(0.04, rel=0.02)  # 16 seas of 3000 samples


def test_the_spectrum_of_seas_that_all_failed_is_nan_not_an_error():
    run = trajectory(np.zeros((N_STEPS + 1, 1)), n_valid=np.array([100]))
    _, density = spectrum(run, window(400.0, DT), "payload_heave")
    assert np.isnan(density).all()
