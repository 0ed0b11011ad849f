"""`heave reproduce`: every figure draws, says its parameters, and a gallery is finished where it stood."""

import json

import pytest

from experiments import figures, reproduce
from experiments.cli import main
from experiments.reproduction.figure import REGISTRY, Caption, reproduction

FIGURES = reproduce.reproductions()
WANTED = (
    *(f"H 3.{n}" for n in range(3, 25)),
    *(f"H 4.{n}" for n in range(2, 22)),
    *(f"H 5.{n}" for n in range(4, 11)),
    *(f"H 6.{n}" for n in range(10, 26)),
    "B 9-2",
    "B 9-3",
    "B 9-5",
    *(f"M {n}" for n in range(2, 11)),
    *(f"W {n}" for n in range(1, 4)),
)


@pytest.fixture
def registered():
    """One figure of its own in place of the project's; `drawn` lists when it was drawn."""
    kept = dict(REGISTRY)
    REGISTRY.clear()
    drawn = []

    @reproduction("W 1", "A line")
    def line(figure):
        figure.subplots().plot([0, 1], [1, 2])
        drawn.append("W 1")
        return Caption(parameters="slope 1", shows="a straight line", assumed="its colour")

    yield drawn
    REGISTRY.clear()
    REGISTRY.update(kept)


def test_every_figure_that_the_sources_compute_is_there():
    assert [label for label in WANTED if label not in FIGURES] == []


@pytest.mark.slow
@pytest.mark.parametrize("item", FIGURES.values(), ids=FIGURES)
def test_every_figure_draws_and_says_its_parameters(item):
    picture, caption = figures.png(item.draw, item.size, 40)
    assert picture.startswith(b"\x89PNG")
    assert caption.parameters
    assert caption.shows


def test_the_page_tells_parameters_assumptions_and_what_is_seen(registered, tmp_path):
    assert main(["reproduce", "--out", str(tmp_path)]) == 0
    page = (tmp_path / "README.md").read_text(encoding="utf-8")
    for said in ("### W 1: A line", "(w_1.png)", "slope 1", "a straight line", "its colour"):
        assert said in page


def test_what_is_drawn_is_kept_unless_asked_or_stale(registered, tmp_path, monkeypatch):
    for arguments in ([], [], ["--anew"]):
        main(["reproduce", *arguments, "--out", str(tmp_path)])
    assert len(registered) == 2
    monkeypatch.setattr(reproduce, "source_hash", lambda: "another")
    main(["reproduce", "--out", str(tmp_path)])
    assert len(registered) == 3
    assert json.loads((tmp_path / "run.json").read_text())["figures"]["W 1"]["source"] == "another"


def test_an_unknown_figure_is_refused_in_a_sentence(tmp_path, capsys):
    assert main(["reproduce", "H 3.99", "--out", str(tmp_path)]) == 2
    assert "unknown figure 'H 3.99'" in capsys.readouterr().err


def test_another_kind_of_folder_is_left_alone(registered, tmp_path, capsys):
    (tmp_path / "run.json").write_text('{"kind": "comparison"}')
    assert main(["reproduce", "--out", str(tmp_path)]) == 2
    assert "holds another kind of run (comparison)" in capsys.readouterr().err
