"""The main job from end to end, as short as it gets."""

from __future__ import annotations

import csv
import json

import pytest

from experiments.cli import main


@pytest.mark.training
def test_the_demo_trains_compares_reports_and_resumes(tmp_path, capsys):
    out = tmp_path / "demo"
    arguments = ["demo", "--steps", "20000", "--seeds", "2", "--duration", "20", "--out", str(out)]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert f"report: {out / 'report.html'}" in said
    assert "agent:ppo" in said
    with (out / "results.csv").open(newline="", encoding="utf-8") as file:
        labels = {row["controller"] for row in csv.DictReader(file)}
    assert labels == {"none", "lqr", "delay_lqr", "lqg", "agent:ppo"}
    run = json.loads((out / "run.json").read_text(encoding="utf-8"))
    agent = run["scenarios"][0]["controllers"][-1]
    assert (
        agent["information_set"]
        == json.loads((out / "ppo" / "run.json").read_text())["scenario"]["information_set"]
    )

    policy = (out / "ppo" / "policy.safetensors").read_bytes()
    assert main(arguments) == 0  # the finished training is taken up as it is
    assert (out / "ppo" / "policy.safetensors").read_bytes() == policy
    capsys.readouterr()

    # The policy in other hands: a scenario it was not trained for, its files cut short, a changed weight.
    spec = f"none,agent:{out / 'ppo'}"
    other = ["compare", "thesis_linear", "--controllers", spec, "--out", str(tmp_path / "other")]
    rough = ["compare", "sea_state_5", "--set", "sea_state.significant_wave_height=4", "--controllers", spec]
    rough += ["--seeds", "1", "--duration", "10", "--out", str(tmp_path / "rough")]
    for refused in (other, rough):
        assert main(refused) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert main([*rough, "--allow-other-scenario"]) == 0
    for broken in (policy[:-9], policy[:-1] + bytes([policy[-1] ^ 1])):
        (out / "ppo" / "policy.safetensors").write_bytes(broken)
        capsys.readouterr()
        assert main(["compare", "sea_state_5", "--controllers", spec, "--out", str(tmp_path / "cut")]) == 2
        assert capsys.readouterr().err.count("\n") == 1
        assert not (tmp_path / "cut").exists()
    assert not (tmp_path / "other").exists()
