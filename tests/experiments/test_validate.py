"""`heave validate`: one page, tables, a failing case fails the command, and nothing finished is lost."""

import csv

import pytest

from experiments import validate
from experiments.cli import main
from experiments.validation.checks import (
    REGISTRY,
    Picture,
    Unmatched,
    absolute,
    at_least,
    at_most,
    relative,
    validation,
)

NAN = float("nan")


@pytest.fixture
def registered(monkeypatch):
    """Two cases of its own in place of the project's; `runs` counts how often each ran."""
    validate.validations()  # all modules are in, so that none registers itself later
    monkeypatch.setattr("experiments.validation.checks.REGISTRY", REGISTRY)
    kept = dict(REGISTRY)
    REGISTRY.clear()
    runs = {"sound": 0, "wrong": 0}

    @validation("closed form")
    def sound():
        """Half of four is two, which is exact."""
        runs["sound"] += 1
        yield relative("half of four [-]", 2.0, 2.0, 1e-12)
        yield absolute("half of six [m]", 3.0, 3.0, 1e-12)
        yield Unmatched("printed half of eight [-]", 4.0, 5.0, "the printer slipped")
        yield Picture("a line", lambda figure: figure.subplots().plot([0, 1], [0, 1]))

    @validation("published", slow=True)
    def wrong():
        """A third of nine is not four, so this fails."""
        runs["wrong"] += 1
        yield relative("third of nine [-]", 3.0, 4.0, 0.1)

    yield runs
    REGISTRY.clear()
    REGISTRY.update(kept)


def table(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(
    ("check", "passed"),
    [
        (relative("x", 1.01, 1.0, 0.02), True),
        (relative("x", 0.97, 1.0, 0.02), False),
        (relative("x", -1.01, -1.0, 0.02), True),
        (absolute("x", 5.4, 5.0, 0.5), True),
        (absolute("x", 5.6, 5.0, 0.5), False),
        (at_most("x", 1.0, 1.0), True),
        (at_most("x", 1.1, 1.0), False),
        (at_least("x", 1.0, 1.0), True),
        (at_least("x", 0.9, 1.0), False),
        (relative("x", NAN, 1.0, 1e9), False),
        (at_most("x", NAN, 1.0), False),
        (at_least("x", float("inf"), 1.0), False),
    ],
)
def test_a_check_passes_within_its_tolerance_and_never_without_a_number(check, passed):
    assert check.passed is passed


def test_a_failing_case_fails_the_command_and_is_told(registered, tmp_path, capsys):
    assert main(["validate", "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    assert "failed: wrong" in said
    assert "third of nine [-]" in said
    rows = table(tmp_path / "validation.csv")
    assert list(rows[0]) == ["case", "quantity", "ours", "reference", "error", "tolerance", "passed"]
    assert [(row["case"], row["passed"]) for row in rows] == [("sound", "1"), ("sound", "1"), ("wrong", "0")]
    assert table(tmp_path / "unmatched.csv")[0]["reason"] == "the printer slipped"
    page = (tmp_path / "validation.html").read_text(encoding="utf-8")
    assert "printed half of eight" in page
    assert "data:image/svg+xml" in page


def test_the_fast_cases_pass_alone(registered, tmp_path, capsys):
    assert main(["validate", "--fast", "--out", str(tmp_path)]) == 0
    assert "2 checks in 1 cases, all passed" in capsys.readouterr().out


def test_what_is_finished_is_not_run_again_unless_asked(registered, tmp_path):
    main(["validate", "sound", "--out", str(tmp_path)])
    main(["validate", "--out", str(tmp_path)])
    assert registered == {"sound": 1, "wrong": 1}
    main(["validate", "sound", "--anew", "--out", str(tmp_path)])
    assert registered["sound"] == 2


def test_another_source_makes_what_was_found_stale(registered, tmp_path, monkeypatch):
    main(["validate", "sound", "--out", str(tmp_path)])
    monkeypatch.setattr(validate, "source_hash", lambda: "another")
    main(["validate", "sound", "--out", str(tmp_path)])
    assert registered["sound"] == 2


def test_a_case_that_breaks_down_fails_with_what_it_said(registered, tmp_path, capsys):
    @validation("agreement")
    def broken():
        """Divides by zero before it compares anything."""
        yield relative("nothing [-]", 1.0 / 0, 1.0, 1.0)

    assert main(["validate", "broken", "--out", str(tmp_path)]) == 1
    assert "ZeroDivisionError" in capsys.readouterr().out


def test_a_case_without_its_package_is_skipped_and_said_so(registered, tmp_path, capsys):
    @validation("independent code", needs="no_such_package")
    def elsewhere():
        """Compares with a code that is not installed here."""
        yield relative("never reached [-]", 1.0, 2.0, 0.1)

    assert main(["validate", "elsewhere", "--out", str(tmp_path)]) == 0
    assert "needs the package no_such_package" in capsys.readouterr().out


def test_an_unknown_case_is_refused_in_a_sentence(tmp_path, capsys):
    assert main(["validate", "sttics", "--out", str(tmp_path)]) == 2
    assert "unknown validation case 'sttics'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_list_runs_nothing(registered, capsys):
    assert main(["validate", "--list"]) == 0
    assert "Half of four is two" in capsys.readouterr().out
    assert registered == {"sound": 0, "wrong": 0}
