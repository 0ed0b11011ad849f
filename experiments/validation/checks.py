"""What a validation case is: a function that yields checks, and pictures of them.

    @validation("closed form")
    def hanging_cable() -> Iterator[Finding]:
        \"\"\"Static stretch of a hanging cable, exact for the scheme; 1e-12 is rounding.\"\"\"
        yield relative("elongation [m]", ours, exact, 1e-12)

The function's name is the case's name, its docstring says what is compared and why the tolerance is what
it is. Reference numbers stand in the case, with their source; none comes from the code under test.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

EVIDENCE = (
    "closed form",
    "order of convergence",
    "agreement",
    "published",
    "independent code",
    "invariant",
)
"""Kinds of evidence, strongest first."""


@dataclass(frozen=True)
class Check:
    """One number beside what it should be."""

    quantity: str
    """What it is, with its unit in brackets."""
    ours: float
    """What the solver says."""
    reference: float
    """What it should be, or the bound it must keep."""
    tolerance: float
    """Largest error that passes, in the error's own measure."""
    error: float
    """Relative error, absolute error, or by how much a bound is exceeded."""
    measure: str
    """`relative`, `absolute`, `at most` or `at least`."""

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; a number that is not finite never passes."""
        return math.isfinite(self.ours) and math.isfinite(self.error) and abs(self.error) <= self.tolerance


@dataclass(frozen=True)
class Unmatched:
    """A published number that does not come out, and why."""

    quantity: str
    """What it is, with its unit in brackets."""
    ours: float
    """What comes out."""
    published: float
    """What is printed."""
    reason: str
    """Why they differ."""


@dataclass(frozen=True)
class Picture:
    """A figure that belongs to a case."""

    title: str
    """What it shows, as a caption."""
    draw: Callable[[Any], None]
    """Draws on an empty Matplotlib figure."""


Finding = Check | Unmatched | Picture


def relative(quantity: str, ours: float, reference: float, tolerance: float) -> Check:
    """`ours` within a fraction `tolerance` of `reference`."""
    error = (float(ours) - reference) / abs(reference)
    return Check(quantity, float(ours), float(reference), tolerance, error, "relative")


def absolute(quantity: str, ours: float, reference: float, tolerance: float) -> Check:
    """`ours` within `tolerance` of `reference`, in the quantity's own unit."""
    return Check(quantity, float(ours), float(reference), tolerance, float(ours) - reference, "absolute")


def at_most(quantity: str, ours: float, bound: float) -> Check:
    """`ours` not above `bound`: a trend, a limit."""
    return Check(quantity, float(ours), float(bound), 0.0, max(0.0, float(ours) - bound), "at most")


def at_least(quantity: str, ours: float, bound: float) -> Check:
    """`ours` not below `bound`."""
    return Check(quantity, float(ours), float(bound), 0.0, max(0.0, bound - float(ours)), "at least")


@dataclass(frozen=True)
class Validation:
    """A registered case."""

    name: str
    """Words of the function's name."""
    evidence: str
    """One of `EVIDENCE`."""
    room: str
    """The solver it is about: the name of the module it stands in."""
    summary: str
    """Its docstring in one line."""
    slow: bool
    """Whether it takes more than a few seconds."""
    needs: str | None
    """A package without which it is skipped."""
    findings: Callable[[], Iterator[Finding]]
    """Runs it."""


REGISTRY: dict[str, Validation] = {}
"""Cases by name, in the order of their definition."""


def validation(evidence: str, *, slow: bool = False, needs: str | None = None) -> Callable[[Any], Any]:
    """Registers a function as a validation case of this kind of evidence."""
    if evidence not in EVIDENCE:
        raise ValueError(f"evidence must be one of {', '.join(EVIDENCE)}, got {evidence!r}")

    def register(findings: Callable[[], Iterator[Finding]]) -> Callable[[], Iterator[Finding]]:
        name = findings.__name__
        if name in REGISTRY:
            raise ValueError(f"two validation cases are called {name!r}")
        summary = " ".join((inspect.getdoc(findings) or "").split())
        room = findings.__module__.rsplit(".", 1)[-1]
        REGISTRY[name] = Validation(name, evidence, room, summary, slow, needs, findings)
        return findings

    return register
