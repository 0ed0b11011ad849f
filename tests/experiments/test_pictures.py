"""Pictures hold what their folders hold: what is drawn, what is written beside it, and what was run."""

from __future__ import annotations

import csv
import dataclasses
import importlib.util
import itertools
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("PIL")

from matplotlib.figure import Figure

from experiments import cli, figures, pictures, runs
from experiments.compare import compare, controller_of
from experiments.leaderboard import Quantity
from experiments.league import contestants, league
from experiments.pictures_fronts import (
    Choice,
    choices,
    distinct,
    front,
    fronts_picture,
    label_of,
    league_picture,
    refined,
    sweep,
)
from experiments.pictures_learning import curve, learning_picture, rivals_of, trainings_of
from experiments.pictures_profiles import paired_ratios, profiles_picture
from experiments.pictures_storm import roughest, series_of, storm_picture
from experiments.pictures_video import MOST_FRAMES, filmed, usual_formats, write_video
from experiments.rollout import FIRST_TEST_SEED, rollout
from heave_env.scenarios import load, to_mapping

SEAS = range(FIRST_TEST_SEED, FIRST_TEST_SEED + 3)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def drawn(picture: pictures.Picture) -> Figure:
    figure = Figure(figsize=picture.size, layout="constrained")
    picture.draw(figure)
    return figure


def line(axis, label):
    """Data of the line with a label."""
    (found,) = (item for item in axis.get_lines() if item.get_label() == label)
    return np.asarray(found.get_xdata(), dtype=float), np.asarray(found.get_ydata(), dtype=float)


def refused(capsys, *arguments) -> str:
    try:
        code = cli.main([str(argument) for argument in arguments])
    except SystemExit as left:
        code = int(left.code or 0)
    said = capsys.readouterr()
    assert (code, said.out) == (2, "")
    assert said.err.startswith("heave: ") and said.err.count("\n") == 1
    return said.err


@pytest.fixture(scope="module")
def comparison(tmp_path_factory):
    """Three controllers in three seas of a linear scenario and of a cable."""
    chosen = [load("limits_linear"), load("sea_state_5")]
    out = tmp_path_factory.mktemp("compared") / "out"
    return compare(chosen, ["none", "feedforward_prediction", "lqr"], n_seeds=3, out=out, duration=40.0)


@pytest.fixture(scope="module")
def scored(comparison):
    return {item.scenario.name: item for item in pictures.read_scored(comparison)}


@pytest.fixture(scope="module")
def contest(tmp_path_factory):
    """A league of two scenarios and a variant."""
    chosen = [load("thesis_linear"), load("limits_linear")]
    out = tmp_path_factory.mktemp("league") / "out"
    given = dict(n_seeds=3, duration=20.0, variants="rougher", reference="lqr", arguments=["league"])
    return league(chosen, ["none", "lqr", "pid"], out=out, workers=1, **given)


# What the folders hold ---------------------------------------------------------------------------


def test_scores_are_those_of_the_folder(comparison, scored):
    assert list(scored) == ["limits_linear", "sea_state_5"]
    rows = [row for row in rows_of(comparison / "episodes.csv") if row["scenario"] == "sea_state_5"]
    item = scored["sea_state_5"]
    for label in ("none", "feedforward_prediction", "lqr"):
        told = [float(row["winch_work [J]"]) for row in rows if row["controller"] == label]
        np.testing.assert_array_equal(item.values[label]["winch_work"], [told])
    assert "winch_work" not in scored["limits_linear"].values["lqr"]
    assert item.number("lqr", "cost").value == pytest.approx(
        json.loads((comparison / "results.json").read_text())["scenarios"]["sea_state_5"]["controllers"][
            "lqr"
        ]["metrics"]["cost"]["mean"]
    )
    assert (item.first_seed, item.n_seas, item.warm_up, item.variant) == (FIRST_TEST_SEED, 3, 10.0, "nominal")
    # Designs are made again for the scenario with its own duration, as they were.
    assert item.basis.duration == load("sea_state_5").duration and item.scenario.duration == 40.0


def test_a_league_is_read_with_its_variants(contest):
    found = pictures.read_scored(contest)
    assert [(item.scenario.name, item.variant) for item in found] == [
        ("thesis_linear", "nominal"),
        ("thesis_linear@rougher", "rougher"),
        ("limits_linear", "nominal"),
        ("limits_linear@rougher", "rougher"),
    ]
    assert [item.scenario.name for item in pictures.chosen(found, None)] == ["thesis_linear", "limits_linear"]
    assert len(pictures.chosen(found, None, variants=True)) == 4
    rows = rows_of(contest / "episodes.csv")
    told = [
        float(row["cost [-]"])
        for row in rows
        if (row["scenario"], row["variant"], row["entry"]) == ("limits_linear", "rougher", "lqr")
    ]
    np.testing.assert_array_equal(found[3].values["lqr"]["cost"], [told])
    fewer = found[3].first_seas(2)
    np.testing.assert_array_equal(fewer.values["lqr"]["cost"], [told[:2]])
    with pytest.raises(ValueError, match="only 3 seas of 'limits_linear@rougher' were run, not 4"):
        found[3].first_seas(4)
    with pytest.raises(ValueError, match="'unknown_linear' was not run there; choose from thesis_linear"):
        pictures.chosen(found, "unknown_linear")


# Fronts ------------------------------------------------------------------------------------------


def choice(energy, std, failed=0, command=1.0, speed=0.0):
    numbers = {"control_energy": Quantity(energy), "payload_heave_std": Quantity(std)}
    weights = {"command_weight": command, "speed_weight": speed}
    return Choice("lqg", weights, False, numbers, failed)


def test_a_front_is_what_nobody_beats_in_both_respects():
    rng = np.random.default_rng(3)
    cloud = [choice(*pair) for pair in rng.uniform(0.1, 1.0, (60, 2))]
    on = front(cloud, "control_energy")
    for item in cloud:
        beaten = any(
            other.numbers["control_energy"].value <= item.numbers["control_energy"].value
            and other.numbers["payload_heave_std"].value <= item.numbers["payload_heave_std"].value
            for other in cloud
            if other is not item
        )
        assert (item in on) == (not beaten)
    stds = [item.numbers["payload_heave_std"].value for item in on]
    assert stds == sorted(stds, reverse=True)
    # What lost the payload in a sea is no choice, however good it was in the others.
    assert front([choice(0.5, 0.5), choice(0.1, 0.1, failed=1)], "control_energy")[0].failed == 0


def test_a_ray_is_refined_where_the_motion_changes_most():
    found = [choice(0.3, 1.0, command=1.0), choice(0.2, 1.1, command=100.0), choice(0.1, 9.0, command=1e4)]
    assert refined(found) == [{"command_weight": 1000.0, "speed_weight": 0.0}]


def test_every_ray_passes_through_the_designs_own_weights():
    own = {"command_weight": 3.0, "speed_weight": 20.0, "mismatch": 0.1}
    found = choices("lqg", load("limits_linear"), own, 5)
    assert found[0] == own and len(found) == 11
    assert all(weights["mismatch"] == 0.1 for weights in found)
    assert all(weights["command_weight"] == 3.0 or weights["speed_weight"] == 20.0 for weights in found)


def test_choices_that_are_told_alike_are_one():
    """Tuned weights have all their digits, a ray's six: what is kept under one name must be one."""
    task = load("limits_linear").task
    own = {"command_weight": task.command_weight * (1.0 + 1e-9), "speed_weight": 20.0}
    found = choices("lqg", load("limits_linear"), own, 9)
    assert found[0] == own and len({label_of(weights) for weights in found}) == len(found)
    assert distinct([*found, dict(own)]) == found


@pytest.fixture(scope="module")
def swept(scored, tmp_path_factory):
    item, folder = scored["sea_state_5"], tmp_path_factory.mktemp("fronts")
    found = sweep("lqr", item.scenario, item.basis, SEAS, folder, n_weights=3, warm_up=item.warm_up)
    return found, folder


def test_a_sweep_is_kept_and_is_that_of_the_design(scored, swept, monkeypatch):
    found, folder = swept
    item = scored["sea_state_5"]
    # The tuned weights are those that the comparison had: the same numbers, to the bit.
    (own,) = (one for one in found if one.tuned)
    assert own.numbers["payload_heave_std"] == item.number("lqr", "payload_heave_std")

    def refuse(*arguments, **options):
        raise AssertionError("what is kept is not run again")

    monkeypatch.setattr("experiments.compare.rollout", refuse)
    again = sweep("lqr", item.scenario, item.basis, SEAS, folder, n_weights=3, warm_up=item.warm_up)
    assert again == found


@pytest.mark.slow
def test_two_processes_sweep_as_one_does(scored, swept, tmp_path):
    item, (found, _) = scored["sea_state_5"], swept
    again = sweep(
        "lqr", item.scenario, item.basis, SEAS, tmp_path, n_weights=3, warm_up=item.warm_up, workers=2
    )
    assert again == found


def test_the_picture_of_fronts_holds_the_folders_numbers(scored, swept, tmp_path):
    item, (found, _) = scored["sea_state_5"], swept
    picture = fronts_picture(item, {"lqr": found})
    written = pictures.write(picture, tmp_path, ["pictures"])
    assert [path.suffix for path in written] == [".png", ".svg", ".csv", ".json"]
    rows = rows_of(tmp_path / "fronts-sea_state_5.csv")
    energy, work = drawn(picture).get_axes()
    for axis, column, factor in ((energy, "control_energy [m²]", 1.0), (work, "winch_work [J]", 1e-6)):
        for entry in ("feedforward_prediction", "lqr"):
            (told,) = (row for row in rows if (row["kind"], row["who"]) == ("entry", entry))
            number = item.number(entry, "payload_heave_std")
            assert [float(told[f"payload_heave_std{end} [m]"]) for end in ("", "_low", "_high")] == [
                number.value,
                number.low,
                number.high,
            ]
            (bars,) = (one for one in axis.containers if one.get_label() == entry)
            x, y = bars.lines[0].get_data()
            assert x == pytest.approx([factor * float(told[column])])
            assert y == pytest.approx([1e3 * number.value])  # in mm
            up = bars.lines[2][1].get_segments()[0][:, 1]
            assert up == pytest.approx([1e3 * number.low, 1e3 * number.high])
        on = [
            row for row in rows if row["kind"] == "swept" and row[f"on front of {column.split()[0]}"] == "1"
        ]
        x, y = line(axis, "lqr front")
        np.testing.assert_allclose(np.sort(x), sorted(factor * float(row[column]) for row in on))
        assert len(on) >= 2 and np.all(np.diff(y) < 0.0)
        # Without control nothing is worked: a line across.
        assert line(axis, "none")[1][0] == pytest.approx(1e3 * item.number("none", "payload_heave_std").value)
    assert len([row for row in rows if row["kind"] == "swept"]) == len(found)


def test_a_linear_scenario_has_one_panel_and_names_apart(scored):
    picture = fronts_picture(scored["limits_linear"], {})
    figure = drawn(picture)
    (axis,) = figure.get_axes()
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axis.texts]
    assert {text.get_text() for text in axis.texts} == {"none", "feedforward_prediction", "lqr"}
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))


def test_every_training_is_shown_beside_their_mean(scored, tmp_path):
    item = scored["limits_linear"]
    two = {metric: np.vstack([rows, 3.0 * rows]) for metric, rows in item.values["lqr"].items()}
    ends = {end: np.vstack([rows, rows]) for end, rows in item.ends["lqr"].items()}
    several = dataclasses.replace(item, values=item.values | {"lqr": two}, ends=item.ends | {"lqr": ends})
    picture = fronts_picture(several, {})
    pictures.write(picture, tmp_path, ["pictures"])
    rows = [row for row in rows_of(tmp_path / "fronts-limits_linear.csv") if row["who"] == "lqr"]
    assert [row["kind"] for row in rows] == ["entry", "training", "training"]
    stds = [float(row["payload_heave_std [m]"]) for row in rows]
    assert stds == pytest.approx([2.0 * stds[1], stds[1], 3.0 * stds[1]])
    (axis,) = drawn(picture).get_axes()
    x, y = line(axis, "lqr trainings")
    np.testing.assert_allclose(x, [float(row["control_energy [m²]"]) for row in rows[1:]])
    np.testing.assert_allclose(y, stds[1:])


def test_names_keep_clear_of_points_and_of_each_other():
    figure = Figure(figsize=(5.0, 4.0), layout="constrained")
    axis = figure.subplots()
    rng = np.random.default_rng(0)
    spots = rng.normal(0.5, 0.05, (9, 2))
    axis.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    texts = figures.name_points(axis, [(f"name {i}", *spot, "#000000") for i, spot in enumerate(spots)])
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in texts]
    points = axis.transData.transform(spots)
    # The box of an annotation holds the line to its point too: the text's own is what must be clear.
    own = [super(type(text), text).get_window_extent() for text in texts]
    assert len(boxes) == 9
    assert not any(one.overlaps(other) for one, other in itertools.combinations(own, 2))
    assert not any(box.contains(*point) for box in own for point in points)


# Linear sRGB as those see it who lack the receptor of long or of medium waves: Machado, Oliveira and
# Fernandes (2009), A physiologically-based model for simulation of color vision deficiency, IEEE
# Transactions on Visualization and Computer Graphics 15(6), 1291-1298, severity 1.
SEEN = {
    "all": np.eye(3),
    "no red": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "no green": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.01182, 0.04294, 0.968881],
    ],
}


def cielab(rgb):
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ rgb
    f = np.cbrt(xyz / np.array([0.9505, 1.0, 1.089]))
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("who", SEEN)
def test_colours_stay_apart_for_those_who_lack_a_receptor(who):
    """By ten units of CIELAB and more, where two or three can just be told."""
    seen = []
    for colour in figures.COLOURS:
        given = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
        linear = np.where(given <= 0.04045, given / 12.92, ((given + 0.055) / 1.055) ** 2.4)
        seen.append(cielab(np.clip(np.asarray(SEEN[who]) @ linear, 1e-3, 1.0)))
    least = min(np.linalg.norm(one - other) for one, other in itertools.combinations(seen, 2))
    print(f"{who}: {least:.1f}")
    assert least > 10.0


def test_heights_are_set_apart_and_stay_in_order():
    found = figures.apart([0.0, 1.0, 1.0, 50.0, 99.0, 100.0], 10.0, 0.0, 100.0)
    assert found == sorted(found)
    assert min(np.diff(found)) >= 10.0 - 1e-9 and found[0] >= 0.0 and found[-1] <= 100.0
    assert found[3] == 50.0
    assert figures.apart([5.0, 80.0], 10.0, 0.0, 100.0) == [5.0, 80.0]


# Storms ------------------------------------------------------------------------------------------


def test_a_storm_is_drawn_from_the_comparisons_folder(comparison, scored, tmp_path, monkeypatch):
    def refuse(*arguments, **options):
        raise AssertionError("a stored sea is not run again")

    monkeypatch.setattr("experiments.compare.rollout", refuse)
    item, seed = scored["sea_state_5"], FIRST_TEST_SEED + 1
    series = series_of(item, None, seed, source=comparison, folder=tmp_path)
    picture = storm_picture(item, series, seed, start=5.0, length=20.0)
    pictures.write(picture, tmp_path, ["pictures"])
    arrays = runs.read_arrays(comparison / "trajectories.npz")
    axes = drawn(picture).get_axes()
    assert len(axes) == 5
    rows = [row for row in rows_of(tmp_path / f"storm-sea_state_5-{seed}.csv") if row["controller"] == "lqr"]
    assert [float(row["time [s]"]) for row in rows] == pytest.approx(np.arange(5.0, 25.01, 0.1))
    for channel, unit, axis, factor in (
        ("payload_heave", "m", axes[1], None),
        ("winch_rate", "m/s", axes[3], 1.0),
        ("sheave_tension", "N", axes[4], 1e-3),
    ):
        held = arrays[f"sea_state_5/lqr/{channel}"][50:251, 1].astype(float)
        np.testing.assert_array_equal([float(row[f"{channel} [{unit}]"]) for row in rows], held)
        y = line(axis, "lqr")[1]
        np.testing.assert_allclose(y, (factor or y[0] / held[0]) * held)
    np.testing.assert_array_equal(
        line(axes[2], "lqr")[1], arrays["sea_state_5/lqr/command"][50:251, 1].astype(float)
    )
    # The drum's rate is what moves the winch.
    moved = np.diff(arrays["sea_state_5/lqr/winch_displacement"][:, 1].astype(float)) / 0.1
    rate = arrays["sea_state_5/lqr/winch_rate"][:, 1].astype(float)
    # Commands arrive between the instants, where the rate jumps: near, but not the same.
    assert np.corrcoef(moved, 0.5 * (rate[1:] + rate[:-1]))[0, 1] > 0.8


def test_another_sea_is_run_again_with_the_same_controllers(comparison, scored, tmp_path):
    item, seed = scored["limits_linear"], FIRST_TEST_SEED + 7
    series = series_of(item, ["none", "lqr"], seed, source=comparison, folder=tmp_path)
    scenario = load("limits_linear")
    again = rollout(scenario, controller_of("lqr", scenario), [seed], duration=40.0)
    for channel in ("payload_heave", "winch_rate"):
        np.testing.assert_array_equal(series["lqr"][channel], again.states[channel][:, 0].astype(np.float32))
    assert list(tmp_path.rglob("*.npz"))  # kept
    with pytest.raises(ValueError, match="'mpc' did not act there; choose from none, "):
        series_of(item, ["mpc"], seed, source=comparison, folder=tmp_path)
    with pytest.raises(ValueError, match="--start must lie before the end of the episode at 40 s"):
        storm_picture(item, series, seed, start=40.0)


def test_the_roughest_sea_is_the_one_in_which_the_boom_tip_moves_most(scored):
    item = scored["limits_linear"]
    scenario = load("limits_linear")
    free = rollout(scenario, controller_of("none", scenario), SEAS, duration=40.0)
    stds = free.states["boom_tip_heave"][101:].std(axis=0)
    assert roughest(item) == FIRST_TEST_SEED + int(np.argmax(stds))
    # What is drawn lies about the largest heave of it.
    series = {
        "none": {"boom_tip_heave": np.zeros(401), "payload_heave": np.zeros(401), "command": np.zeros(400)}
    }
    series["none"]["boom_tip_heave"][[30, 250]] = (9.0, -5.0)
    picture = storm_picture(item, series, 1, length=10.0)
    assert (picture.about["start"], picture.about["end"]) == (20.0, 30.0)


# Learning curves ---------------------------------------------------------------------------------


def training(folder: Path, seed: int, rows, *, algorithm="ppo", name="limits_linear", **preset) -> Path:
    """A run folder as a training leaves it, of given steps, wall times and costs."""
    settings = {"evaluation_seas": 4, "evaluation_duration": 20.0, "guide": None, "guide_mode": "residual"}
    about = {
        "kind": "training",
        "algorithm": algorithm,
        "seed": seed,
        "scenario_name": name,
        "scenario": to_mapping(load(name)),
        "preset": settings | preset,
    }
    runs.write_json(folder / "run.json", about)
    columns = (
        "step",
        "wall_s",
        "cost_mean",
        "cost_median",
        "cost_max",
        "payload_heave_std",
        "command_std",
        "failed",
    )
    table = [(step, wall, cost, cost, 2.0 * cost, 0.1 * cost, 0.3, 0.0) for step, wall, cost in rows]
    runs.write_text(folder / "evaluations.csv", runs.table_text(columns, table))
    return folder


@pytest.fixture()
def trained(tmp_path):
    costs = ((9.0, 3.0, 1.0), (8.0, 4.0, 2.0), (7.0, 5.0, 3.0), (6.0, 6.0, 4.0), (100.0, 50.0, 20.0))
    for seed, row in enumerate(costs):
        rows = [(1000 * i, (10.0 + seed) * i, cost) for i, cost in enumerate(row)]
        training(tmp_path / f"ppo_{seed}", seed, rows)
    training(tmp_path / "sac", 0, [(0, 0.0, 9.0), (1500, 60.0, 5.0)], algorithm="sac")
    return tmp_path


def test_a_learning_curve_is_the_middle_and_the_range_of_its_seeds(trained):
    found = trainings_of([f"{trained}/ppo_*", f"slow={trained}/sac"])
    assert {name: len(group) for name, group in found.items()} == {"ppo": 5, "slow": 1}
    whole = curve(found["ppo"], "cost_mean")
    np.testing.assert_array_equal(whole.step, [0.0, 1000.0, 2000.0])
    # Of five seeds the lowest and the highest are left out.
    np.testing.assert_allclose(whole.middle, [8.0, 5.0, 3.0])
    np.testing.assert_allclose(whole.low, [6.0, 3.0, 1.0])
    np.testing.assert_allclose(whole.high, [100.0, 50.0, 20.0])
    np.testing.assert_allclose(whole.wall, [0.0, 12.0, 24.0])
    # Seeds that were evaluated at other steps are joined as far as all of them go.
    mixed = curve([found["ppo"][0], found["slow"][0]], "payload_heave_std")
    np.testing.assert_array_equal(mixed.step, [0.0, 1000.0, 1500.0])
    np.testing.assert_allclose(mixed.low, [0.9, 0.3, 0.2])


def test_the_picture_of_learning_holds_the_evaluations(trained, tmp_path):
    found = trainings_of([f"{trained}/ppo_*", f"{trained}/sac"])
    rival = {"lqg": {"cost_mean": 0.5}}
    picture = learning_picture(found, "cost_mean", rival)
    pictures.write(picture, tmp_path, ["pictures"])
    rows = rows_of(tmp_path / "learning-limits_linear.csv")
    single = [row for row in rows if (row["kind"], row["name"], row["seed"]) == ("seed", "ppo", "4")]
    assert [float(row["value"]) for row in single] == [100.0, 50.0, 20.0]
    steps, wall = drawn(picture).get_axes()
    np.testing.assert_allclose(line(steps, "ppo"), ([0.0, 1.0, 2.0], [8.0, 5.0, 3.0]))  # thousands
    np.testing.assert_allclose(line(wall, "ppo"), ([0.0, 12.0, 24.0], [8.0, 5.0, 3.0]))
    np.testing.assert_allclose(line(steps, "lqg")[1], 0.5)
    band = steps.collections[0].get_paths()[0].vertices
    assert (band[:, 1].min(), band[:, 1].max()) == (1.0, 100.0)
    (told,) = (row for row in rows if row["kind"] == "rival")
    assert (told["name"], float(told["value"])) == ("lqg", 0.5)


def test_rivals_act_in_the_same_validation_seas(trained, tmp_path):
    pytest.importorskip("stable_baselines3")
    from agents.train import validation

    (first, *_) = trainings_of([f"{trained}/ppo_0"])["ppo"]
    scenario = load("limits_linear")
    found = rivals_of(["lqr"], first, tmp_path)
    told = validation(controller_of("lqr", scenario), scenario, n_seas=4, duration=20.0)
    assert found == {"lqr": told}
    assert rivals_of(["lqr"], first, tmp_path) == found


def test_trainings_that_do_not_compare_are_refused(trained):
    training(trained / "other", 0, [(0, 0.0, 1.0)], evaluation_duration=30.0)
    with pytest.raises(ValueError, match="were validated in other scenarios or seas; draw them apart"):
        trainings_of([f"{trained}/sac", f"{trained}/other"])
    with pytest.raises(ValueError, match="is named twice"):
        trainings_of([f"{trained}/sac", f"{trained}/sac"])
    with pytest.raises(ValueError, match="holds no training"):
        trainings_of([str(trained)])
    training(trained / "young", 0, [])
    with pytest.raises(ValueError, match="has no evaluation yet"):
        trainings_of([f"{trained}/young"])


# Profiles ----------------------------------------------------------------------------------------


def test_profiles_count_every_sea_and_each_scenario_alike(contest, tmp_path):
    found = pictures.chosen(pictures.read_scored(contest), None)
    picture = profiles_picture(found)
    pictures.write(picture, tmp_path, ["pictures"])
    rows = rows_of(contest / "episodes.csv")

    def cost(scenario, entry):
        own = [row for row in rows if (row["scenario"], row["variant"]) == (scenario, "nominal")]
        return np.array([float(row["cost [-]"]) for row in own if row["entry"] == entry])

    for entry in ("none", "pid"):
        ratios = [cost(name, entry) / cost(name, "lqr") for name in ("thesis_linear", "limits_linear")]
        told = [row for row in rows_of(tmp_path / "profiles.csv") if row["entry"] == entry]
        x, y = line(drawn(picture).get_axes()[0], entry)
        np.testing.assert_array_equal(x, [float(row["ratio [-]"]) for row in told])
        counted = [np.mean([np.mean(part <= at) for part in ratios]) for at in x]
        np.testing.assert_allclose([float(row["share [-]"]) for row in told], counted)
        np.testing.assert_allclose(y, 100.0 * np.array(counted))
        low, high = (np.array([float(row[f"{end} [-]"]) for row in told]) for end in ("low", "high"))
        assert np.all(low <= np.array(counted) + 1e-9) and np.all(high >= np.array(counted) - 1e-9)
    assert paired_ratios(found, "lqr")["lqr"][0].tolist() == [[1.0, 1.0, 1.0]]
    with pytest.raises(ValueError, match="reference 'mpc' did not act in 'thesis_linear'"):
        profiles_picture(found, "mpc")


# Videos ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def film():
    scenario = load("sea_state_5")
    acting = {name: controller_of(name, scenario) for name in ("none", "lqr")}
    return filmed(scenario, acting, FIRST_TEST_SEED, start=3.0, length=1.0)


def test_a_video_shows_the_sea_that_was_run(film, tmp_path):
    written = write_video(film, tmp_path, formats=("gif",), width=300, arguments=["pictures"])
    rows = [
        row
        for row in rows_of(tmp_path / f"video-sea_state_5-{FIRST_TEST_SEED}.csv")
        if row["controller"] == "lqr"
    ]
    scenario = load("sea_state_5")
    again = rollout(scenario, controller_of("lqr", scenario), [FIRST_TEST_SEED], duration=5.0)
    for channel in ("payload_heave", "sheave_tension", "winch_rate"):
        (column,) = (name for name in rows[0] if name.startswith(f"{channel} ["))
        told = [float(row[column]) for row in rows]
        np.testing.assert_array_equal(told, again.states[channel][30:41, 0])
    from PIL import Image

    with Image.open(written[0]) as image:
        assert image.n_frames == len(film.steps) == 11
        assert image.info["duration"] == 100 and image.info["loop"] == 0 and image.width == 300


def test_the_same_seed_makes_the_same_video(film, tmp_path):
    scenario = load("sea_state_5")
    acting = {name: controller_of(name, scenario) for name in ("none", "lqr")}
    again = filmed(scenario, acting, FIRST_TEST_SEED, start=3.0, length=1.0)
    for folder, shown in ((tmp_path / "a", film), (tmp_path / "b", again)):
        write_video(shown, folder, formats=usual_formats(), width=300, arguments=["pictures"])
    for path in (tmp_path / "a").glob("video*"):
        if path.suffix != ".json":  # which tells the date
            assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()
    other = filmed(scenario, acting, FIRST_TEST_SEED + 1, start=3.0, length=1.0)
    assert np.any(other.frame(35) != film.frame(35))


def test_the_scenes_differ_where_the_payload_does(film):
    frame = film.frame(40)
    assert frame.dtype == np.uint8 and frame.shape == (716, 770, 3)
    left, right = frame[:480, :382].astype(int), frame[:480, 388:].astype(int)
    differs = np.any(left != right, axis=2)
    assert differs[100:440, 200:272].any()  # cable and payload
    assert not differs[180:230, 300:].any()  # water
    assert film.frame_data(film.takes[0], 40).motion_range == film.frame_data(film.takes[1], 40).motion_range


def test_what_is_shown_faster_has_fewer_frames(film, tmp_path):
    """No more frames in a second than can be shown, whatever the control step and the speed."""
    scenario = load("thesis_linear")
    acting = {"none": controller_of("none", scenario)}
    for speed in (0.5, 1.0, 4.0):
        found = filmed(scenario, acting, 1, start=0.0, length=2.0, speed=speed)
        pause = found.stride * scenario.control_dt / speed
        assert 1.0 / MOST_FRAMES - 1e-9 <= pause < 1.0 / MOST_FRAMES + scenario.control_dt / speed
    with pytest.raises(ValueError, match="speed must be from 0.1 to 20, got 30"):
        filmed(scenario, acting, 1, start=0.0, length=2.0, speed=30.0)


@pytest.mark.skipif(importlib.util.find_spec("imageio_ffmpeg") is None, reason="needs imageio-ffmpeg")
def test_the_encoder_writes_every_frame(film, tmp_path):
    import imageio_ffmpeg

    written = write_video(film, tmp_path, formats=("mp4", "webm"), width=300, arguments=["pictures"])
    for path in written[:2]:
        frames, _ = imageio_ffmpeg.count_frames_and_secs(str(path))
        assert frames == len(film.steps)


# The command -------------------------------------------------------------------------------------


def test_the_page_of_a_league_shows_its_pictures(contest, capsys):
    page = contest / "leaderboard.html"
    before = page.read_text(encoding="utf-8").count("data:image/svg")
    assert cli.main(["pictures", "profiles", str(contest)]) == 0
    assert cli.main(["pictures", "storm", str(contest), "--scenario", "limits_linear", "--length", "10"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert all(Path(name).is_file() for name in said) and len(said) == 8
    text = page.read_text(encoding="utf-8")
    assert text.count("data:image/svg") == before + 2
    assert f"limits_linear, sea {FIRST_TEST_SEED}" in text
    (contest / "pictures" / "profiles.json").write_text("{broken", encoding="utf-8")
    assert [item["picture"] for item in pictures.stored(contest)] == ["storm"]


def test_the_page_of_a_league_shows_everybody_with_intervals(contest, monkeypatch):
    summary = json.loads((contest / "leaderboard.json").read_text(encoding="utf-8"))
    (told,) = (
        item
        for item in summary["standings"]
        if (item["scenario"], item["variant"]) == ("limits_linear", "nominal")
    )
    figure = Figure(figsize=(6.0, 4.5), layout="constrained")
    monkeypatch.setattr(figures, "svg", lambda draw, size: draw(figure) or "drawn")
    entries = {name: item["quantities"] for name, item in told["entries"].items()}
    text, caption = league_picture("limits_linear", entries, sorted(entries))
    assert text == "drawn" and caption.startswith("limits_linear: standard deviation of payload heave")
    (axis,) = figure.get_axes()
    for entry in ("lqr", "pid"):
        std, energy = entries[entry]["payload_heave_std"], entries[entry]["control_energy"]
        (bars,) = (one for one in axis.containers if one.get_label() == entry)
        x, y = bars.lines[0].get_data()
        assert (x[0], y[0]) == pytest.approx((energy["value"], std["value"]))
        across, up = (one.get_segments()[0] for one in bars.lines[2])
        assert across[:, 0] == pytest.approx([energy["low"], energy["high"]])
        assert up[:, 1] == pytest.approx([std["low"], std["high"]])
    assert line(axis, "none")[1][0] == pytest.approx(entries["none"]["payload_heave_std"]["value"])


def test_the_command_draws_fronts_of_named_controllers(tmp_path, capsys):
    given = ["--controllers", "none,lqr", "--designs", "lqr", "--weights", "2", "--seeds", "2"]
    given += ["--duration", "20", "--first-sea", "training", "--workers", "1", "--out", str(tmp_path)]
    assert cli.main(["pictures", "fronts", "thesis_linear", *given]) == 0
    told = json.loads((tmp_path / "fronts-thesis_linear.json").read_text(encoding="utf-8"))
    assert told["first_seed"] == 9_500_000 and "heave pictures fronts" in told["provenance"]["command"]
    kinds = [row["kind"] for row in rows_of(tmp_path / "fronts-thesis_linear.csv")]
    assert kinds.count("entry") == 2 and kinds.count("swept") >= 3
    capsys.readouterr()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["fronts", "limits_linear", "--designs", "pid"], "'pid' has no weights to sweep; choose from lqr,"),
        (["fronts", "limits_linear", "--first-sea", "x"], "--first-sea takes test, validation, training or"),
        (["fronts", "limits_linear", "--scenario", "x"], "--scenario chooses from what a folder holds"),
        (["fronts", "nowhere"], "unknown scenario 'nowhere'"),
        (["storm", "limits_linear", "--seed", "x"], "--seed takes the seed of a sea or roughest, got 'x'"),
        (["storm", "limits_linear", "--controllers", "lqq"], "unknown controller 'lqq'"),
        (["learning", "nowhere"], "'nowhere' holds no training"),
        (["learning", "nowhere*"], "no training matches 'nowhere*'"),
        (["learning", "nowhere", "--quantity", "x"], "there is no quantity 'x'; choose from cost_mean,"),
        (["profiles", "nowhere"], "'nowhere' holds no comparison and no league"),
        (["video", "thesis_linear", "--format", "avi"], "a video is gif, mp4, webm, got 'avi'"),
        (["video", "thesis_linear", "--format", "gif", "--start", "1000"], "the video ends at 1030 s, the"),
        (["painting"], "argument KIND: invalid choice: 'painting'"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_a_sentence(tmp_path, capsys, arguments, said):
    out = ["--out", tmp_path] if len(arguments) > 1 else []
    assert said in refused(capsys, "pictures", *arguments, *out)
    assert not list(tmp_path.iterdir())


def test_a_runs_folder_is_no_folder_for_pictures(comparison, capsys):
    said = refused(capsys, "pictures", "storm", "thesis_linear", "--out", comparison)
    assert "holds another kind of run (comparison)" in said


def test_a_folders_seas_are_those_it_was_run_in(comparison, tmp_path, capsys):
    for option in (["--first-sea", "training"], ["--duration", "20"], ["--set", "length=500"]):
        said = refused(capsys, "pictures", "fronts", comparison, *option, "--out", tmp_path)
        assert f"{option[0]} " in said
    assert not list(tmp_path.iterdir())


def test_contestants_of_a_picture_are_those_of_a_league():
    assert [team.name for team in contestants(["none", "mine=lqg"])] == ["none", "mine"]


def test_the_command_starts_without_drawing():
    code = "import sys, experiments.cli; print('matplotlib' in sys.modules, 'numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "False False", done.stderr
