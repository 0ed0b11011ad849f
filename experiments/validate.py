"""`heave validate`: runs the validation cases, keeps what each found, and writes one page and tables.

A finished case is kept in the folder and not run again while the program's source stays the same, so an
interrupted validation goes on where it was.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import pkgutil
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import experiments.validation
from experiments import figures, page, runs
from experiments.validation.checks import EVIDENCE, REGISTRY, Check, Picture, Unmatched, Validation
from heave_env.parameters import name_hint
from heave_env.provenance import provenance

VALIDATION = "validation"
"""`kind` in the `run.json` of a validation's folder."""
PAGE_FILE = "validation.html"
TABLE_FILE = "validation.csv"
UNMATCHED_FILE = "unmatched.csv"
COLUMNS = ("case", "quantity", "ours", "reference", "error", "tolerance", "passed")

Found = dict[str, Any]
"""What a case found, as plain JSON values."""


def validations() -> dict[str, Validation]:
    """Every registered case by name, by solver and evidence."""
    for module in pkgutil.iter_modules(experiments.validation.__path__):
        importlib.import_module(f"experiments.validation.{module.name}")
    order = {kind: i for i, kind in enumerate(EVIDENCE)}
    return dict(sorted(REGISTRY.items(), key=lambda item: (item[1].room, order[item[1].evidence])))


def chosen(names: Sequence[str], *, fast: bool = False) -> list[Validation]:
    """The cases of the given names or solvers; all if none is given.

    Raises:
        ValueError: If a name is unknown.
    """
    known = validations()
    rooms = {case.room for case in known.values()}
    for name in names:
        if name not in known and name not in rooms:
            hint = name_hint(name, [*known, *rooms], "list them with heave validate --list")
            raise ValueError(f"unknown validation case {name!r}; {hint}")
    wanted = [case for case in known.values() if not names or case.name in names or case.room in names]
    return [case for case in wanted if not (fast and case.slow)]


@cache
def source_hash(parts: tuple[str, ...] = ("heave_env", "baselines", "agents", "experiments")) -> str:
    """A hash of the program's source: what was found with another source is found anew.

    Args:
        parts: Rooms, and single files below the root.
    """
    root = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for part in parts:
        for path in sorted((root / part).rglob("*.py")) or [root / part]:
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def run_case(case: Validation) -> Found:
    """Runs one case and returns what it found; an exception is a failed check of its own."""
    found: Found = {"name": case.name, "skipped": None, "checks": [], "unmatched": [], "pictures": []}
    if case.needs is not None and importlib.util.find_spec(case.needs) is None:
        return found | {"skipped": f"needs the package {case.needs}"}
    begin = time.perf_counter()
    try:
        for finding in case.findings():
            if isinstance(finding, Check):
                found["checks"].append(vars(finding) | {"passed": finding.passed})
            elif isinstance(finding, Unmatched):
                found["unmatched"].append(dict(vars(finding)))
            elif isinstance(finding, Picture):
                found["pictures"].append({"title": finding.title, "svg": figures.svg(finding.draw)})
    except Exception as error:
        said = f"runs to its end ({type(error).__name__}: {' '.join(str(error).split())})"
        broken = Check(said, float("nan"), 1.0, 0.0, float("nan"), "absolute")
        found["checks"].append(vars(broken) | {"passed": False})
    return found | {"seconds": time.perf_counter() - begin}


def validate(
    out: str | Path,
    cases: Sequence[Validation],
    *,
    anew: bool = False,
    arguments: list[str] | None = None,
    progress: Callable[[str], None] = lambda name: None,
) -> list[Found]:
    """Runs the cases that are not in the folder yet and writes page and tables.

    Args:
        out: The folder.
        cases: What to run.
        anew: Run also what the folder holds.
        arguments: The command line, for the record.
        progress: Called with the name of each case before it runs.

    Returns:
        What each case found, in their order.
    """
    folder = runs.check_folder(out, VALIDATION)
    source = source_hash()
    made = {"kind": VALIDATION, "provenance": provenance(arguments), "source": source}
    runs.write_json(folder / runs.RUN_FILE, made)
    everything = []
    for case in cases:
        part = folder / "cases" / f"{case.name}.json"
        kept = None if anew or not part.exists() else runs.read_json(part)
        if not isinstance(kept, dict) or kept.get("source") != source:
            progress(case.name)
            kept = runs.plain(run_case(case)) | {"source": source}
            runs.write_json(part, kept)
        everything.append(kept)
    rows = [
        [found["name"], *(check[key] for key in COLUMNS[1:])]
        for found in everything
        for check in found["checks"]
    ]
    runs.write_text(folder / TABLE_FILE, runs.table_text(COLUMNS, rows))
    lost = [
        [found["name"], *(item[key] for key in ("quantity", "ours", "published", "reason"))]
        for found in everything
        for item in found["unmatched"]
    ]
    headings = ("case", "quantity", "ours", "published", "reason")
    runs.write_text(folder / UNMATCHED_FILE, runs.table_text(headings, lost))
    runs.write_text(folder / PAGE_FILE, _page(cases, everything, made))
    return everything


def failed(everything: Sequence[Found]) -> list[str]:
    """Names of the cases of which a check failed, or that found nothing though they ran."""
    return [
        found["name"]
        for found in everything
        if not found["skipped"]
        and (not found["checks"] or not all(check["passed"] for check in found["checks"]))
    ]


def number_text(value: float | None) -> str:
    """A number to six significant digits, without idle zeros."""
    return "–" if value is None else f"{value:.6g}".replace("-", "−")


def error_text(check: dict[str, Any]) -> str:
    """A check's error as read by people: in per cent if relative, by how much a bound is exceeded."""
    if check["error"] is None:
        return "–"
    if check["measure"] == "relative":
        return f"{_short(100.0 * check['error'])} %"
    if check["measure"] in ("at most", "at least") and check["error"] == 0.0:
        return "kept"
    return _short(check["error"])


def tolerance_text(check: dict[str, Any]) -> str:
    """A check's tolerance in the measure of its error."""
    if check["measure"] == "relative":
        return f"{_short(100.0 * check['tolerance'])} %"
    if check["measure"] in ("at most", "at least"):
        return check["measure"]
    return _short(check["tolerance"])


def _short(value: float) -> str:
    return f"{value:.2g}".replace("-", "−")


def _page(cases: Sequence[Validation], everything: Sequence[Found], made: dict[str, Any]) -> str:
    rooms: dict[str, list[dict[str, Any]]] = {}
    failures = set(failed(everything))
    for case, found in zip(cases, everything, strict=True):
        checks = [
            check
            | {
                "ours": number_text(check["ours"]),
                "reference": number_text(check["reference"]),
                "error": error_text(check),
                "tolerance": tolerance_text(check),
            }
            for check in found["checks"]
        ]
        unmatched = [
            item | {"ours": number_text(item["ours"]), "published": number_text(item["published"])}
            for item in found["unmatched"]
        ]
        view = {
            "name": case.name,
            "evidence": case.evidence,
            "summary": case.summary,
            "passed": case.name not in failures,
            "skipped": found["skipped"],
            "checks": checks,
            "unmatched": unmatched,
            "pictures": [
                {"title": item["title"], "source": page.embedded(item["svg"])} for item in found["pictures"]
            ],
        }
        rooms.setdefault(case.room, []).append(view)
    n_checks = sum(len(found["checks"]) for found in everything)
    context = {
        "rooms": rooms,
        "n_cases": len(cases),
        "n_checks": n_checks,
        "n_skipped": sum(found["skipped"] is not None for found in everything),
        "failures": sorted(failures),
        "made": made["provenance"],
    }
    return page.render("validation.html.j2", context)
