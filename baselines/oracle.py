"""The oracle, who knows what each episode drew: a yardstick for adaptive controllers, and no rival.

For every seed the parameters that its first episode draws are read off the plant, and `lqg` (or `mpc`, where
the winch has limits) is designed for the scenario that has them. What it costs is what knowing the parameters
beforehand is worth; the sea it has to infer like everybody. Where nothing is uncertain it is that design.

The weights are those of the scenario as it is, tuned where its plant is more than the linear model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from baselines.linear_controller import LinearController, without_matrices
from baselines.lqg import lqg
from baselines.mpc import mpc
from baselines.tuning import needs_tuning, tuned_weights
from heave_env.plant import Plant
from heave_env.scenarios import Scenario
from heave_env.sea import Array

DESIGNS: dict[str, Callable[..., LinearController]] = {"oracle": lqg, "oracle_mpc": mpc}
"""What each oracle designs."""


@dataclass(frozen=True, eq=False)
class Oracle(LinearController):
    """A controller for each row, which must be the seeds that it was made for, in their first episode."""

    controllers: tuple[LinearController, ...] = ()
    """One for each set of parameters drawn."""
    chosen: tuple[int, ...] = ()
    """Which of them is each row's, (n_envs,)."""

    @cached_property
    def rows(self) -> list[Array]:
        """Rows of each controller."""
        return [np.flatnonzero(np.array(self.chosen) == i) for i in range(len(self.controllers))]

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""
        return max(controller.n_memory for controller in self.controllers)

    def respond(self, y: Array, memory: Array) -> tuple[Array, Array]:
        """Command in metres, (n_envs, 1), and the next memory, for measurements in SI units."""
        if len(y) != len(self.chosen):
            raise ValueError(
                f"controller {self.name!r} was made for {len(self.chosen)} seeds, got {len(y)} rows; make it "
                "for the seeds that it acts in"
            )
        command, following = np.empty((len(y), 1)), np.zeros_like(memory)
        for controller, rows in zip(self.controllers, self.rows, strict=True):
            n = controller.n_memory
            command[rows], following[rows, :n] = controller.respond(y[rows], memory[rows, :n])
        return command, following


def drawn_parameters(scenario: Scenario, seeds: Sequence[int]) -> list[dict[str, float]]:
    """What the first episode of each seed draws, by name."""
    plant = Plant(scenario, len(seeds))
    plant.begin(np.ones(len(seeds), dtype=bool), np.array(seeds))
    names = [draw.parameter for draw in scenario.uncertainty]
    return [dict(zip(names, map(float, row), strict=True)) for row in plant.drawn]


def oracle(
    scenario: Scenario,
    seeds: Sequence[int],
    *,
    design: str = "oracle",
    progress: Callable[[int], None] | None = None,
) -> Oracle:
    """Designs a controller for what each seed's first episode draws.

    Args:
        scenario: The operation.
        seeds: One seed per row, at least one.
        design: `oracle` (`lqg` for each) or `oracle_mpc` (`mpc`).
        progress: Called after each design with the number of seeds it is for.

    Raises:
        ValueError: If there is no seed, the design is unknown, or the scenario does not give what it needs.
    """
    if design not in DESIGNS:
        raise ValueError(f"design of the oracle must be one of {', '.join(DESIGNS)}, got {design!r}")
    if len(seeds) == 0:
        raise ValueError("an oracle needs the seeds that it acts in, got none")
    designer, plain = DESIGNS[design], scenario.with_drawn({})
    weights = tuned_weights(designer.__name__, designer, plain, {}) if needs_tuning(plain) else {}
    drawn = drawn_parameters(scenario, seeds)
    places: dict[tuple[float, ...], int] = {}
    chosen = tuple(places.setdefault(tuple(values.values()), len(places)) for values in drawn)
    controllers = []
    for i in range(len(places)):
        known = scenario.with_drawn(drawn[chosen.index(i)])
        controllers.append(designer(known, **weights))
        if progress is not None:
            progress(chosen.count(i))
    measures = controllers[0].measures
    return Oracle(
        **without_matrices(design, scenario, measures),
        controllers=tuple(controllers),
        chosen=chosen,
    )
