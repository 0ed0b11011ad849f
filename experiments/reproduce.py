"""`heave reproduce`: the sources' figures drawn anew, with a page that says with which parameters."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import experiments.reproduction
from experiments import figures, runs
from experiments.reproduction.figure import REGISTRY, Reproduction
from experiments.validate import source_hash
from heave_env.parameters import name_hint
from heave_env.provenance import versions

GALLERY = "gallery"
"""`kind` in the `run.json` of a gallery's folder."""
PAGE_FILE = "README.md"
DPI = 100

CHAPTERS = {
    "H 2": "Huang (1992), chapter 2: statics",
    "H 3": "Huang (1992), chapter 3: the axial cable",
    "H 4": "Huang (1992), chapter 4: the planar cable",
    "H 5": "Huang (1992), chapter 5: the line in three dimensions",
    "H 6": "Huang (1992), chapter 6: control",
    "B 9": "Berteaux, chapter 9: lowering mechanics",
    "M": "Moustafa (2001): the single sagged span",
    "W": "Welch and Tulin (1993): the towed cable",
}
"""Parts of the gallery by the beginning of their figures' labels, in order."""


def chapter_of(label: str) -> str:
    """The part that a figure's label belongs to."""
    return next(
        part for part in CHAPTERS if label == part or label.startswith((f"{part}.", f"{part}-", f"{part} "))
    )


def _order(label: str) -> tuple[int, int]:
    number = label.replace("-", ".").replace(" ", ".").rsplit(".", 1)[-1]
    return list(CHAPTERS).index(chapter_of(label)), int(number)


def reproductions() -> dict[str, Reproduction]:
    """Every registered figure by label, in the order of the gallery."""
    for module in pkgutil.iter_modules(experiments.reproduction.__path__):
        importlib.import_module(f"experiments.reproduction.{module.name}")
    return dict(sorted(REGISTRY.items(), key=lambda item: _order(item[0])))


def chosen(labels: Sequence[str]) -> list[Reproduction]:
    """The figures of the given labels or chapters (`H 3.5`, `H 3`); all if none is given.

    Raises:
        ValueError: If a label is unknown.
    """
    known = reproductions()
    wanted: dict[str, Reproduction] = {}
    for label in labels or list(CHAPTERS):
        found = {name: item for name, item in known.items() if label in (name, chapter_of(name))}
        if labels and not found:
            hint = name_hint(label, [*known, *CHAPTERS], "list them with heave reproduce --list")
            raise ValueError(f"unknown figure {label!r}; {hint}")
        wanted |= found
    return [item for name, item in known.items() if name in wanted]


def reproduce(
    out: str | Path,
    wanted: Sequence[Reproduction],
    *,
    anew: bool = False,
    progress: Callable[[str], None] = lambda label: None,
) -> Path:
    """Draws the figures that the folder does not hold yet and writes its page.

    A figure is kept while the program's source stays the same; what else the folder holds stays on the page.

    Args:
        out: The folder.
        wanted: What to draw.
        anew: Draw also what the folder holds.
        progress: Called with the label of each figure before it is drawn.

    Returns:
        The page's path.
    """
    folder = runs.check_folder(out, GALLERY)
    source = source_hash()
    run_file = folder / runs.RUN_FILE
    drawn = runs.read_json(run_file).get("figures", {}) if run_file.exists() else {}
    for item in wanted:
        kept = drawn.get(item.label, {})
        if not anew and kept.get("source") == source and (folder / item.file_name).exists():
            continue
        progress(item.label)
        picture, caption = figures.png(item.draw, item.size, DPI)
        runs.write_bytes(folder / item.file_name, picture)
        drawn[item.label] = {"title": item.title, "source": source, **asdict(caption)}
        about = {"kind": GALLERY, "versions": versions(), "figures": drawn}
        runs.write_json(run_file, about)
    known = reproductions()
    on_page = [item for label, item in known.items() if label in drawn]
    return runs.write_text(folder / PAGE_FILE, _page(on_page, drawn))


def _page(shown: Sequence[Reproduction], drawn: dict[str, dict[str, str]]) -> str:
    lines = [
        "# The sources' figures, drawn anew",
        "",
        "Each figure is computed by the solvers of this project and drawn by",
        "",
        "    heave reproduce --out docs/gallery",
        "",
        "Only the text of the sources was at hand, not their pictures: nothing published is drawn in, but",
        "for numbers that the text prints, which are marked as such. Below each figure stand the parameters",
        "used, what was assumed where print is incomplete, and what is to be seen.",
    ]
    chapter = None
    for item in shown:
        if chapter_of(item.label) != chapter:
            chapter = chapter_of(item.label)
            lines += ["", f"## {CHAPTERS[chapter]}"]
        said = drawn[item.label]
        lines += ["", f"### {item.label}: {item.title}", "", f"![{item.title}]({item.file_name})", ""]
        lines += [f"*Parameters.* {said['parameters']}", ""]
        if said["assumed"]:
            lines += [f"*Assumed.* {said['assumed']}", ""]
        lines.append(f"*To be seen.* {said['shows']}")
    return "\n".join(lines) + "\n"
