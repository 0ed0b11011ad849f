"""What a case is: a frozen dataclass of parameters whose `outcome` runs a solver.

    @dataclass(frozen=True, kw_only=True)
    class Tow:
        \"\"\"A uniform cable towed straight behind a vessel.\"\"\"

        cable: Cable
        \"\"\"What is towed.\"\"\"
        ...

        def outcome(self) -> Outcome: ...

    @case("towing")
    def lightweight_cable() -> Tow:
        \"\"\"A 10 mm cable towed at 3 m/s.\"\"\"
        return Tow(cable=..., ...)

Its fields are numbers, strings, booleans, tuples and parameter objects of `heave_env.parameters`, so that
every case goes to YAML and back; each field carries its docstring, which becomes the comment there.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Quantity:
    """One number of an outcome."""

    name: str
    """Its name in words with underscores, as `top_tension`."""
    value: float
    """The number [SI]."""
    unit: str
    """Its unit, `-` if there is none."""
    meaning: str
    """What it is, in a few words."""


@dataclass(frozen=True)
class Outcome:
    """What running a case brought."""

    quantities: tuple[Quantity, ...]
    """The numbers worth printing."""
    tables: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)
    """Tables by name; columns by heading with the unit in brackets, as `tension [N]`, each (n_rows,)."""
    pictures: Mapping[str, Callable[[Any], None]] = field(default_factory=dict)
    """By name, what draws on an empty Matplotlib figure."""


class Case(Protocol):
    """Parameters of one run of a solver."""

    def outcome(self) -> Outcome:
        """Runs it.

        Raises:
            ValueError: If the parameters are impossible together.
            ConvergenceError: If the solver finds no answer.
        """
        ...


@dataclass(frozen=True)
class Named:
    """A registered case."""

    name: str
    """The function's name."""
    solver: str
    """The solver it runs."""
    description: str
    """Its docstring in one line."""
    build: Callable[[], Any]
    """Makes its parameters."""


REGISTRY: dict[str, Named] = {}
"""Cases by name."""


def case(solver: str) -> Callable[[Any], Any]:
    """Registers a function that builds a case of a solver, under the function's name."""

    def register(build: Callable[[], Any]) -> Callable[[], Any]:
        name = build.__name__
        if name in REGISTRY:
            raise ValueError(f"two cases are called {name!r}")
        description = " ".join((inspect.getdoc(build) or "").split())
        REGISTRY[name] = Named(name, solver, description, build)
        return build

    return register
