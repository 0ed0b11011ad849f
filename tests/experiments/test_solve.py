"""`heave cases` and `heave solve`: every named case goes to YAML and back, runs, and is written down."""

import csv
import dataclasses
import math

import pytest

from experiments import figures, solve
from experiments.cli import main
from heave_env import document
from heave_env.document import field_docs

CASES = solve.named_cases()
SOLVERS = ("axial", "lowering", "lumped_mass", "planar", "sagged_span", "statics", "towing", "waves")


def test_every_solver_has_cases():
    assert sorted({named.solver for named in CASES.values()}) == list(SOLVERS)


@pytest.mark.parametrize("named", CASES.values(), ids=CASES)
def test_a_case_survives_its_yaml(named, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(solve.to_yaml(named, named.build()), encoding="utf-8")
    again, parameters = solve.load(str(path))
    assert again == named
    assert parameters == named.build()


@pytest.mark.parametrize("named", CASES.values(), ids=CASES)
def test_a_case_explains_itself(named):
    assert len(named.description) > 20
    kind = type(named.build())
    assert [item.name for item in dataclasses.fields(kind) if item.name not in field_docs(kind)] == []


@pytest.mark.parametrize("named", CASES.values(), ids=CASES)
def test_a_case_runs_and_everything_it_says_is_finite(named):
    outcome = named.build().outcome()
    assert outcome.quantities
    assert all(math.isfinite(item.value) for item in outcome.quantities)
    for columns in outcome.tables.values():
        assert len({len(values) for values in columns.values()}) == 1
    for draw in outcome.pictures.values():
        assert figures.svg(draw).startswith("<svg")


def test_solving_writes_parameters_numbers_tables_and_pictures(tmp_path, capsys):
    name = next(name for name, named in CASES.items() if named.solver == "towing")
    assert main(["solve", name, "--out", str(tmp_path)]) == 0
    with (tmp_path / "quantities.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    said = capsys.readouterr().out
    assert all(row["quantity"] in said for row in rows)
    again, parameters = solve.load(str(tmp_path / "case.yaml"))
    assert (again.name, parameters) == (name, CASES[name].build())
    assert list(tmp_path.glob("*.svg"))


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["solve", "nosuch"], "unknown case 'nosuch'"),
        (["cases", "show"], "wants the name of a case"),
        (["cases", "list", "--solver", "finite"], "solvers: axial"),
        (["solve", "nowhere.yaml"], "cannot read case file 'nowhere.yaml'"),
    ],
)
def test_wrong_requests_end_in_a_sentence_and_code_2(arguments, complaint, capsys):
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("content", ["- 1\n", "length: 3.0\n", "case: [1]\n"])
def test_a_file_that_is_no_case_is_refused(content, tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    path.write_text(content)
    assert main(["solve", str(path)]) == 2
    assert "whose key 'case' names the case" in capsys.readouterr().err


@pytest.mark.parametrize("named", CASES.values(), ids=CASES)
def test_a_word_in_place_of_a_number_is_named(named, capsys):
    path = first_number(document.to_mapping(named.build()))
    assert main(["solve", named.name, "--set", f"{path}=fast"]) == 2
    assert path.rsplit(".", 1)[-1] in capsys.readouterr().err


def first_number(mapping: dict) -> str:
    """Dotted path of the first number in a mapping of parameters."""
    for key, value in mapping.items():
        if isinstance(value, float):
            return key
        if isinstance(value, dict):
            return f"{key}.{first_number(value)}"
        if isinstance(value, list) and value and isinstance(value[0], dict):
            return f"{key}.0.{first_number(value[0])}"
    raise AssertionError("no number")
