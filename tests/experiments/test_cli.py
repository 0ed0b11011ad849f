"""The `heave` command as users type it: what it prints and writes, and how it refuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from experiments import cli
from heave_env import scenarios

ROOT = Path(__file__).resolve().parents[2]
VERBS = (
    "demo",
    "scenarios",
    "simulate",
    "train",
    "sweep",
    "compare",
    "league",
    "evaluate",
    "zoo",
    "report",
    "pictures",
    "operability",
    "identify",
    "cases",
    "solve",
    "validate",
    "reproduce",
    "bench",
)


def heave(*arguments: str, **options) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "experiments.cli", *arguments],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=120,
        **options,
    )


def run(capsys, *arguments) -> tuple[int, str, str]:
    """Runs a command line in this process: exit code, stdout and stderr."""
    try:
        code = cli.main([str(argument) for argument in arguments])
    except SystemExit as left:
        code = int(left.code or 0)
    said = capsys.readouterr()
    return code, said.out, said.err


def refused(capsys, *arguments) -> str:
    """The sentence with which a wrong command line is refused."""
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("heave: ")
    assert err.count("\n") == 1
    return err


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_with_an_example(capsys, verb):
    code, out, _ = run(capsys, verb, "--help")
    assert code == 0
    assert f"example:\n  heave {verb}" in out


def test_the_list_names_every_scenario(capsys):
    code, out, _ = run(capsys, "scenarios", "list")
    assert code == 0
    assert all(name in out for name in scenarios.names())


def test_a_shown_scenario_is_a_file_that_reads_back(capsys, tmp_path):
    code, out, _ = run(capsys, "scenarios", "show", "sea_state_5", "--set", "winch.command_delay=0.4")
    assert code == 0
    (tmp_path / "mine.yaml").write_text(out, encoding="utf-8")
    mine = scenarios.load(tmp_path / "mine.yaml")
    assert mine.winch.command_delay == 0.4
    assert mine.sensors == scenarios.load("sea_state_5").sensors


def test_a_users_own_file_is_simulated_and_compared(capsys, tmp_path):
    _, out, _ = run(capsys, "scenarios", "show", "thesis_linear")
    mine = tmp_path / "mine.yaml"
    mine.write_text(out.replace('name: "thesis_linear"', 'name: "mine"'), encoding="utf-8")
    assert run(capsys, "simulate", mine, "--duration", 1, "--out", tmp_path / "run.csv")[0] == 0
    code, out, _ = run(
        capsys,
        "compare",
        mine,
        "--controllers",
        "none,lqg",
        "--seeds",
        2,
        "--duration",
        20,
        "--out",
        tmp_path / "c",
    )
    assert code == 0
    assert "mine: 2 unseen seas" in out
    assert "payload std [mm]" in out
    assert "shorter than the protocol" in out
    assert (tmp_path / "c" / "report.html").exists()


def test_settings_are_yaml_scalars():
    scenario = cli.scenario_of(
        "sea_state_5",
        ["task.position_weight=1e4", "length=500", "winch.speed_limit=0.5", "cable.tension_only=true"],
    )
    assert scenario.task.position_weight == 1e4
    assert scenario.initial_length == 500.0
    assert scenario.winch.speed_limit == 0.5
    assert scenario.cable.tension_only is True
    assert cli.scenario_of("sea_state_5", ["winch.speed_limit=null"]).winch.speed_limit is None


def test_a_comparison_is_reported_again(capsys, tmp_path):
    out = tmp_path / "c"
    assert run(capsys, "compare", "thesis_linear", "--seeds", 2, "--duration", 20, "--out", out)[0] == 0
    (out / "report.html").unlink()
    code, text, _ = run(capsys, "report", out)
    assert code == 0
    assert text == f"report: {out / 'report.html'}\n"
    command = json.loads((out / "run.json").read_text(encoding="utf-8"))["provenance"]["command"]
    assert command.startswith("heave compare thesis_linear --seeds 2")


def test_the_command_itself_runs_from_a_shell(tmp_path):
    done = heave("simulate", "sea_state_5", "--duration", "1", "--out", str(tmp_path / "run.csv"))
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "run.csv").read_text(encoding="utf-8").count("\n") > 11


def test_a_reader_that_leaves_early_is_no_error():
    done = subprocess.run(
        f"{sys.executable} -m experiments.cli scenarios show sea_state_5 | head -1",
        shell=True,
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=120,
    )
    assert done.stderr == ""


def test_an_interruption_leaves_with_130_and_no_file(capsys, tmp_path, monkeypatch):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("experiments.simulate.rollout", interrupt)
    out = tmp_path / "run.csv"
    out.write_text("old", encoding="utf-8")
    code, _, err = run(capsys, "simulate", "thesis_linear", "--out", out)
    assert code == 130
    assert "interrupted" in err
    assert out.read_text(encoding="utf-8") == "old"


def test_an_interrupted_training_says_how_to_go_on(capsys, tmp_path, monkeypatch):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("agents.train.train", interrupt)
    code, _, err = run(capsys, "train", "thesis_linear", "--out", tmp_path / "run")
    assert code == 130
    assert "the same command goes on" in err


# Wrong inputs ------------------------------------------------------------------------------------

WRONG_SETTINGS = [
    ("winch.time_constant=-1", "Winch.time_constant must be a positive number"),
    ("winch.time_constant=.nan", "positive number"),
    ("winch.time_konstant=1", "did you mean 'time_constant'"),
    ("nothing=1", "unknown key"),
    ("length", "KEY.PATH=VALUE"),
    ("length=[1", "not valid YAML"),
    ("duration=0.05", "whole number of steps"),
    ("information_set=all", "one of full_state"),
    ("cable.diameter=thick", "positive number"),
]


@pytest.mark.parametrize(("setting", "sentence"), WRONG_SETTINGS)
def test_a_wrong_setting_is_refused_and_nothing_overwritten(capsys, tmp_path, setting, sentence):
    out = tmp_path / "run.csv"
    out.write_text("old", encoding="utf-8")
    assert sentence in refused(capsys, "simulate", "sea_state_5", "--set", setting, "--out", out)
    assert out.read_text(encoding="utf-8") == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]


WRONG_MOTIONS = [
    ("time,heave\n0,0\n1,0\n2,\n3,0\n4,0\n", "fill the gap"),
    ("time,heave\n0,0\n1,nan\n2,0\n3,0\n", "fill the gap"),
    ("time,heave\n0,0\n2,0\n1,0\n3,0\n", "sort the times"),
    ("time,heave\n0,0\n1,0\n1,0\n3,0\n", "sort the times"),
    ("time,z\n0,0\n1,0\n2,0\n3,0\n", "lacks the column 'heave'"),
    ("heave\n0\n1\n2\n3\n", "lacks the column 'time'"),
    ("time,heave\n0,0\n1,0\n", "at least 4"),
    ("", "lacks the column"),
    ("time,heave\n0,0\n0.01,0\n0.02,0\n0.03,0\n", "less than one control step"),
]


@pytest.mark.parametrize(("content", "sentence"), WRONG_MOTIONS)
def test_a_wrong_motion_file_is_refused_and_nothing_overwritten(capsys, tmp_path, content, sentence):
    motion, out = tmp_path / "motion.csv", tmp_path / "run.csv"
    motion.write_text(content, encoding="utf-8")
    out.write_text("old", encoding="utf-8")
    assert sentence in refused(capsys, "simulate", "thesis_cable", "--motion", motion, "--out", out)
    assert out.read_text(encoding="utf-8") == "old"


def test_a_motion_file_that_ends_before_the_run_is_refused(capsys, tmp_path):
    motion = tmp_path / "motion.csv"
    motion.write_text("time,heave\n" + "".join(f"{t},0\n" for t in range(6)), encoding="utf-8")
    arguments = (
        "simulate",
        "thesis_cable",
        "--motion",
        motion,
        "--duration",
        9,
        "--out",
        tmp_path / "run.csv",
    )
    assert "lasts 5 s, the run 9 s" in refused(capsys, *arguments)


WRONG_COMMANDS = [
    (("simulate", "sea_state_6", "--out", "OUT"), "did you mean 'sea_state_5'"),
    (("simulate", "missing.yaml", "--out", "OUT"), "cannot read scenario file"),
    (("simulate", "sea_state_5"), "--out"),
    (("simulate", "sea_state_5", "--out", "."), "is a folder"),
    (("simulate", "sea_state_5", "--controller", "lqi", "--out", "OUT"), "unknown controller 'lqi'"),
    (("simulate", "sea_state_5", "--motion", "missing.csv", "--out", "OUT"), "cannot read motion file"),
    (("simulate", "sea_state_5", "--seed", "-1", "--out", "OUT"), "not negative"),
    (("simulate", "sea_state_5", "--duration", "nan", "--out", "OUT"), "positive number of seconds"),
    (("simulate", "sea_state_5", "--duration", "0.15", "--out", "OUT"), "whole number of control steps"),
    (("compare", "sea_state_5", "--controllers", "none,lqgg", "--out", "OUT"), "did you mean 'lqg'"),
    (("compare", "sea_state_5", "--seeds", "0", "--out", "OUT"), "at least 1"),
    (("compare", "sea_state_5", "--seeds", "few", "--out", "OUT"), "few"),
    (("compare", "sea_state_5", "--controllers", "agent:nowhere", "--out", "OUT"), "there is no run"),
    (("train", "sea_state_5", "--algorithm", "dqn"), "invalid choice"),
    (("train", "sea_state_5", "--steps", "0.5"), "positive whole number"),
    (("scenarios", "show"), "wants the name"),
    (("scenarios", "list", "--tag", "calm"), "no scenario has the tag"),
    (("report", "."), "holds no comparison"),
    (("identify", "thesis_linear"), "cable"),
    (("fly",), "invalid choice"),
    ((), "required"),
]


@pytest.mark.parametrize(("arguments", "sentence"), WRONG_COMMANDS)
def test_a_wrong_command_is_refused_with_a_sentence(capsys, tmp_path, monkeypatch, arguments, sentence):
    monkeypatch.chdir(tmp_path)
    assert sentence in refused(capsys, *arguments)
    assert not list(tmp_path.iterdir())


def test_a_wrong_file_of_ones_own_is_refused(capsys, tmp_path):
    mine = tmp_path / "mine.yaml"
    for content, sentence in (
        ("name: [", "not valid YAML"),
        ("- a\n", "must be a mapping"),
        ("name: mine\nwench: {}\n", "unknown key 'wench'"),
        ("name: mine\n", "missing key"),
    ):
        mine.write_text(content, encoding="utf-8")
        assert sentence in refused(capsys, "simulate", mine, "--out", tmp_path / "run.csv")


def test_a_refusal_comes_from_the_shell_too(tmp_path):
    done = heave("simulate", "nowhere", "--out", str(tmp_path / "run.csv"))
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("heave: unknown scenario 'nowhere'")
    assert done.stderr.count("\n") == 1
