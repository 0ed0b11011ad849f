"""Scenarios x controllers x seeds: the same unseen seas for everybody, scored and written down.

A comparison's folder is described in `docs/files.md`, its protocol in `docs/comparison.md`.
"""

from __future__ import annotations

import dataclasses
import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import runs
from experiments.kept import kept_file, read_kept, write_kept
from experiments.metrics import (
    SCORED,
    WARM_UP,
    Window,
    metric_names,
    removed,
    scores,
    spectrum,
    window,
)
from experiments.processes import shared_out
from experiments.results import (
    CLAIRVOYANT,
    Contest,
    Entry,
    Outcome,
    joined_arrays,
    outcome_arrays,
    outcome_of,
    write_contests,
)
from experiments.rollout import FIRST_TEST_SEED, Trajectory, batches, rollout, with_duration
from heave_env.controller import Controller, NoControl
from heave_env.parameters import name_hint
from heave_env.provenance import provenance, versions
from heave_env.scenarios import Scenario

Array = np.ndarray

AGENT_PREFIX = "agent:"
ZOO_PREFIX = "zoo:"
FILE_PREFIX = "file:"
N_STORED_SEAS = 3
"""Seas whose time series are stored [-]."""
DECISIVE = ("heave_env", "baselines", "experiments/rollout.py", "experiments/metrics.py")
"""Source that decides what a designed controller is found to do."""
LIBRARIES = ("python", "numpy", "scipy", "numba")
"""Packages whose versions do."""
SLOW = ("multi_model_mpc", "multi_model", "oracle_mpc", "oracle", "mpc_l1", "mpc")
"""Those that take longest, the slowest first."""
SLOW_SEAS = 64
"""Seas of theirs that are run and kept at a time where no time series are wanted [-]."""
Progress = Callable[[str, int], None]
"""Takes a label and a number of steps done since the last call."""
CLAIRVOYANT_SEAS = 8
"""Seas of the clairvoyant yardstick that are worked out and kept at a time [-]."""


def controller_names() -> tuple[str, ...]:
    """Names of the designed controllers."""
    from baselines import CONTROLLERS

    return tuple(CONTROLLERS)


def is_agent(spec: str) -> bool:
    """Whether a controller that is asked for is a trained agent."""
    return spec.startswith((AGENT_PREFIX, ZOO_PREFIX))


def check_specs(specs: Sequence[str]) -> tuple[str, ...]:
    """The controllers asked for: known names, `agent:RUN`, `zoo:NAME/SEED` or `file:PATH.py`, none twice.

    A `zoo:NAME` stands for all its trainings.

    Raises:
        ValueError: If one is unknown, repeated, or there is none.
    """
    wanted = tuple(part for spec in specs if spec.strip() for part in trainings_of(spec.strip()))
    if not wanted:
        raise ValueError(f"no controller was named; choose from {', '.join(controller_names())}, agent:RUN")
    for spec in wanted:
        if wanted.count(spec) > 1:
            raise ValueError(f"controller {spec!r} is named twice; name it once")
        if spec.startswith(AGENT_PREFIX):
            if not spec.removeprefix(AGENT_PREFIX):
                raise ValueError("agent: lacks the run folder; write agent:RUN, as agent:runs/demo/ppo")
            run = spec.removeprefix(AGENT_PREFIX)
            if not Path(run).exists():
                raise ValueError(f"there is no run {run!r}; train one with heave train")
        elif spec.startswith(FILE_PREFIX):
            if not spec.removeprefix(FILE_PREFIX):
                raise ValueError("file: lacks the Python file; write file:PATH.py, as file:mine.py")
        elif not spec.startswith(ZOO_PREFIX) and spec not in controller_names():
            known = controller_names()
            hint = name_hint(spec, known, f"known: {', '.join(known)}, agent:RUN, zoo:NAME, file:PATH.py")
            raise ValueError(f"unknown controller {spec!r}; {hint}")
    return wanted


def trainings_of(spec: str) -> tuple[str, ...]:
    """`zoo:NAME/SEED` for each training of a `zoo:NAME`; anything else as it is.

    Raises:
        ValueError: If the zoo has no such agent or training.
    """
    if not spec.startswith(ZOO_PREFIX):
        return (spec,)
    from agents.zoo import specs_of

    return specs_of(spec)


def labels_of(specs: Sequence[str]) -> dict[str, str]:
    """A short label per controller: `agent:` and the run's folder name, `file:` and its name, the whole
    path where that clashes."""

    def short(spec: str) -> str:
        if spec.startswith(FILE_PREFIX):
            return FILE_PREFIX + Path(spec.removeprefix(FILE_PREFIX)).stem
        if not spec.startswith(AGENT_PREFIX):
            return spec
        path = Path(spec.removeprefix(AGENT_PREFIX)).resolve()
        return AGENT_PREFIX + (path.parent.name if path.is_file() else path.name)

    shorts = [short(spec) for spec in specs]
    return {spec: name if shorts.count(name) == 1 else spec for spec, name in zip(specs, shorts, strict=True)}


def controller_of(spec: str, scenario: Scenario, *, allow_other_scenario: bool = False) -> Controller:
    """The designed controller of that name, the policy of an `agent:RUN` or of the zoo, or what a
    `file:PATH.py` holds, for a scenario.

    Of a `zoo:NAME` the training that costs least on validation seas is taken.

    Raises:
        ValueError: If there is no such controller, or it does not fit the scenario.
    """
    if spec.strip().startswith(ZOO_PREFIX):
        from agents.zoo import load_agent

        return load_agent(spec.strip(), scenario, allow_other_scenario=allow_other_scenario)
    (spec,) = check_specs([spec])
    if spec == "none":
        return NoControl()
    if spec.startswith(AGENT_PREFIX):
        from agents.policy import load_policy

        path = spec.removeprefix(AGENT_PREFIX)
        return load_policy(path, scenario, allow_other_scenario=allow_other_scenario)
    if spec.startswith(FILE_PREFIX):
        from experiments.submission import load_submission

        return load_submission(spec.removeprefix(FILE_PREFIX), scenario)
    import baselines

    return baselines.design(spec, scenario)


def content_hash(spec: str) -> str | None:
    """A hash of the file that makes a controller what it is; None of a designed one, whose source does.

    Raises:
        ValueError: If the file cannot be read.
    """
    if spec.startswith(FILE_PREFIX):
        path = Path(spec.removeprefix(FILE_PREFIX))
    elif spec.startswith(ZOO_PREFIX):
        from agents.policy import POLICY_FILE
        from agents.zoo import policy_folder

        path = policy_folder(spec) / POLICY_FILE
    elif spec.startswith(AGENT_PREFIX):
        from agents.policy import POLICY_FILE

        path = Path(spec.removeprefix(AGENT_PREFIX))
        path = path / POLICY_FILE if path.is_dir() else path.with_suffix(".json")
    else:
        return None
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise ValueError(
            f"there is no controller in {str(path)!r}; name a run folder that heave train has written, or a "
            "Python file"
        ) from error


def entry_of(label: str, spec: str, scenario: Scenario, *, allow_other_scenario: bool = False) -> Entry:
    """A controller designed or loaded for a scenario, under a label.

    Raises:
        ValueError: If there is no such controller, or it does not fit the scenario.
    """
    controller = controller_of(spec, scenario, allow_other_scenario=allow_other_scenario)
    sees = getattr(controller, "information_set", None) or scenario.information_set
    return Entry(label, spec, controller, sees)


def _identity(
    scenario: Scenario, spec: str, seeds: Sequence[int], part: Window, dtype: str, sees: str, n_stored: int
) -> dict[str, Any]:
    """What must be the same for a kept part to be taken as it is."""
    from experiments.validate import source_hash

    known = versions()
    return {
        "scenario": scenario.fingerprint,
        "duration": scenario.duration,
        "controller": spec.partition(":")[0],
        "content": content_hash(spec),
        "information_set": sees,
        "seeds": hashlib.sha256(repr(list(seeds)).encode()).hexdigest()[:16],
        "n_seeds": len(seeds),
        "scored": dataclasses.astuple(part),
        "dtype": dtype,
        "n_stored": n_stored,
        "source": source_hash((*DECISIVE, "agents") if is_agent(spec) else DECISIVE),
        "versions": {name: known[name] for name in LIBRARIES},
    }


def play(
    scenario: Scenario,
    entry: Entry,
    seeds: Sequence[int],
    part: Window,
    *,
    dtype: str = "float64",
    n_stored: int = N_STORED_SEAS,
    progress: Callable[[int], None] | None = None,
) -> Outcome:
    """Lets one controller act in every sea of a scenario and scores it.

    The efficiency against the locked winch is left open, and so is the proven optimum.

    Args:
        scenario: The operation, with the duration that is wanted.
        entry: The controller.
        seeds: One seed per sea.
        part: The steps that count.
        dtype: Precision of the plant.
        n_stored: Seas whose time series are kept; with none, spectra are left out too.
        progress: Called with the number of sea steps done since the last call.
    """
    samples: list[Trajectory] = []
    rows: list[tuple[dict[str, Array], dict[str, Array]]] = []
    spectra = []
    omega = np.empty(0)
    for batch in batches(scenario, seeds):
        trajectory = rollout(
            scenario,
            entry.controller,
            batch,
            dtype=dtype,
            information_set=entry.information_set,
            progress=progress,
        )
        if not rows:  # the first batch is the largest
            decision_time, n_batch = trajectory.decision_time, len(batch)
        found = {}
        for channel in ("payload_heave", "boom_tip_heave") if n_stored else ():
            omega, found[channel] = spectrum(trajectory, part, channel)
        room = max(0, n_stored - sum(sample.n_seas for sample in samples))
        samples.append(trajectory.selected(room))
        rows.append((scores(trajectory, part), trajectory.outcomes))
        spectra.append(found)
    # Batches are of equal size but for the last: each counts by its seas.
    weights = [len(row["cost"]) for row, _ in rows]
    return Outcome(
        entry=entry,
        values={
            name: np.concatenate([row[name] for row, _ in rows])
            for name in metric_names(scenario)
            if name in rows[0][0]
        },
        ends={name: np.concatenate([ends[name] for _, ends in rows]) for name in rows[0][1]},
        sample=_joined([sample for sample in samples if sample.n_seas] or samples[:1]),
        omega=omega,
        spectra={
            channel: np.average([found[channel] for found in spectra], axis=0, weights=weights)
            for channel in spectra[0]
        },
        optimal_cost=None,
        decision_time=decision_time,
        batch=n_batch,
    )


@dataclass(frozen=True, kw_only=True)
class Part:
    """What is run, and kept, as a whole: one controller or yardstick in seas of one scenario."""

    scenario: Scenario
    label: str
    spec: str
    sees: str
    """Its information set."""
    seeds: Sequence[int]
    """One seed per sea."""
    scored: Window
    """The steps that count."""
    dtype: str
    """Precision of the plant."""
    n_stored: int
    """Seas whose time series are kept; with none, spectra are left out too."""
    entry: Entry | None = None
    """The controller; None of a yardstick."""
    name: str
    """What it is kept under."""

    @property
    def n_steps(self) -> int:
        """Control steps of all its seas [-]."""
        return len(self.seeds) * self.scenario.n_steps

    def identity(self) -> dict[str, Any]:
        """What must be the same for it to be taken as it was kept."""
        return _identity(
            self.scenario, self.spec, self.seeds, self.scored, self.dtype, self.sees, self.n_stored
        )

    def held(self, folder: Path) -> dict[str, Array] | None:
        """What a folder holds of it, or None."""
        return read_kept(kept_file(folder, self.scenario.name, self.name), self.identity())

    def keep(self, folder: Path, arrays: dict[str, Array]) -> None:
        """Keeps what it found.

        Raises:
            ValueError: If it cannot be written.
        """
        write_kept(kept_file(folder, self.scenario.name, self.name), self.identity(), arrays)

    def outcome(self, progress: Progress | None = None) -> Outcome:
        """Runs a controller."""
        assert self.entry is not None

        def report(count: int) -> None:
            if progress is not None:
                progress(self.label, count)

        return play(
            self.scenario,
            self.entry,
            self.seeds,
            self.scored,
            dtype=self.dtype,
            n_stored=self.n_stored,
            progress=report,
        )

    def run(self, progress: Progress | None = None) -> dict[str, Array]:
        """Runs it; what there is to keep, with the time that it took, `wall` [s]."""
        began = time.perf_counter()
        if self.entry is not None:
            arrays = outcome_arrays(self.outcome(progress))
        elif self.label == CLAIRVOYANT:
            arrays = {"cost": self._clairvoyant(progress)}
        else:
            arrays = {"cost": self._oracle(progress)}
        return arrays | {"wall": np.array(time.perf_counter() - began)}

    def _clairvoyant(self, progress: Progress | None) -> Array:
        from baselines.clairvoyant import clairvoyant_cost

        costs = clairvoyant_cost(self.scenario, self.seeds, warm_up=self.scored.warm_up)
        if progress is not None:
            progress(self.label, self.n_steps)
        return costs

    def _oracle(self, progress: Progress | None) -> Array:
        from baselines.oracle import oracle

        def report(label: str, count: int) -> None:
            if progress is not None:
                progress(label, count)

        costs = []
        for batch in batches(self.scenario, self.seeds):
            made = oracle(
                self.scenario,
                batch,
                design=self.label,
                progress=lambda count: report(f"{self.label} designs", count * self.scenario.n_steps),
            )
            entry = Entry(self.label, self.label, made, self.sees)
            found = play(
                self.scenario,
                entry,
                batch,
                self.scored,
                dtype=self.dtype,
                n_stored=0,
                progress=lambda count: report(self.label, count),
            )
            costs.append(found.values["cost"])
        return np.concatenate(costs)


def parts_of(
    scenario: Scenario,
    entries: Sequence[Entry],
    seeds: Sequence[int],
    *,
    warm_up: float | None = None,
    dtype: str = "float64",
    clairvoyant: bool = False,
    oracle: bool = False,
    n_stored: int = N_STORED_SEAS,
) -> list[Part]:
    """What a contest is made of, in the order in which it is run; arguments are those of `run_contest`."""
    scored = window(scenario.duration, scenario.control_dt, warm_up)

    def part(label: str, spec: str, sees: str, **given: Any) -> Part:
        given = {"seeds": seeds, "name": label} | given
        return Part(
            scenario=scenario,
            label=label,
            spec=spec,
            sees=sees,
            scored=scored,
            dtype=dtype,
            n_stored=n_stored,
            **given,
        )

    def parts(label: str, spec: str, sees: str, size: int, **given: Any) -> list[Part]:
        if size >= len(seeds):
            return [part(label, spec, sees, **given)]
        return [
            part(label, spec, sees, seeds=seeds[first : first + size], name=f"{label} {first}", **given)
            for first in range(0, len(seeds), size)
        ]

    locked = locked_among(entries, scenario)
    found = []
    for entry in (locked, *(entry for entry in entries if entry is not locked)):
        size = SLOW_SEAS if entry.spec in SLOW and not n_stored else len(seeds)
        found += parts(entry.label, entry.spec, entry.information_set, size, entry=entry)
    sees = scenario.information_set
    for label in oracle_labels(scenario) if oracle else ():
        found += parts(label, label, sees, SLOW_SEAS)
    if clairvoyant:
        found += parts(CLAIRVOYANT, CLAIRVOYANT, sees, CLAIRVOYANT_SEAS)
    return found


def locked_among(entries: Sequence[Entry], scenario: Scenario) -> Entry:
    """The entry that does nothing; a locked winch of its own where none was asked for."""
    locked = next((entry for entry in entries if entry.spec == "none"), None)
    return locked or Entry("locked winch", "none", NoControl(), scenario.information_set)


def finish(
    parts: Sequence[Part], folder: Path, workers: int, progress: Callable[[Part], None] | None = None
) -> None:
    """Runs in several processes what a folder does not hold yet, and keeps it there as it is finished.

    What comes from a Python file is left to the process that has loaded it.

    Args:
        parts: What is wanted.
        folder: Where it is kept.
        workers: Processes; with one, nothing is done: the contest itself runs what is missing.
        progress: Called with each part that is there.
    """
    if workers <= 1:
        return
    wanted = []
    for part in parts:
        if part.spec.startswith(FILE_PREFIX) or part.held(folder) is None:
            wanted.append(part)
        elif progress is not None:
            progress(part)
    # Who plans or refines takes longest: none of them should be begun last.
    wanted = [part for part in wanted if not part.spec.startswith(FILE_PREFIX)]
    wanted.sort(key=lambda part: SLOW.index(part.spec) if part.spec in SLOW else len(SLOW))
    for part, arrays in shared_out(Part.run, wanted, workers):
        part.keep(folder, arrays)
        if progress is not None:
            progress(part)


def run_contest(
    scenario: Scenario,
    entries: Sequence[Entry],
    seeds: Sequence[int],
    *,
    warm_up: float | None = None,
    dtype: str = "float64",
    clairvoyant: bool = False,
    oracle: bool = False,
    n_stored: int = N_STORED_SEAS,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> Contest:
    """Runs every controller in the same seas of a scenario and scores it.

    Args:
        scenario: The operation, with the duration that is wanted.
        entries: The controllers.
        seeds: One seed per sea.
        warm_up: Time left out at the start [s]; None: the protocol's.
        dtype: Precision of the plant.
        clairvoyant: Whether the cost of who knows the sea beforehand is worked out, seconds for each sea.
        oracle: Whether those run too who know what each episode draws.
        n_stored: Seas whose time series are kept; with none, spectra are left out too.
        folder: Where each controller's part is kept as it is finished, and taken from if it is there already;
            None: nowhere.
        progress: Called with a label and a number of steps done since the last call.

    Returns:
        Scores and the first seas in full (of a part that was kept, the stored channels).
    """
    from baselines.bound import causal_bound, optimal_cost

    def kept(part: Part) -> dict[str, Array]:
        arrays = None if folder is None else part.held(folder)
        if arrays is None:
            arrays = part.run(progress)
            if folder is not None:
                part.keep(folder, arrays)
        elif progress is not None:
            progress(part.label, part.n_steps)
        return arrays

    found: dict[str, Outcome] = {}
    costs: dict[str, list[Array]] = {}
    several: dict[str, list[dict[str, Array]]] = {}
    parts = parts_of(
        scenario,
        entries,
        seeds,
        warm_up=warm_up,
        dtype=dtype,
        clairvoyant=clairvoyant,
        oracle=oracle,
        n_stored=n_stored,
    )
    for part in parts:
        if part.entry is None:
            costs.setdefault(part.label, []).append(kept(part)["cost"])
        elif folder is None and len(part.seeds) == len(seeds):
            found[part.label] = part.outcome(progress)
        else:
            rows = several.setdefault(part.label, [])
            rows.append(kept(part))
            found[part.label] = outcome_of(joined_arrays(rows), part.entry, scenario.control_dt)
    oracles = {label: np.concatenate(rows) for label, rows in costs.items() if label != CLAIRVOYANT}
    free = found[locked_among(entries, scenario).label].values["payload_heave_std"]
    optima = {
        sees: optimal_cost(dataclasses.replace(scenario, information_set=sees))
        for sees in {entry.information_set for entry in entries}
    }
    outcomes = []
    for entry in entries:
        item = found[entry.label]
        values = item.values | {"efficiency_locked_winch": removed(item.values["payload_heave_std"], free)}
        if oracles:
            values["cost_over_oracle"] = values["cost"] / list(oracles.values())[-1]
        outcomes.append(dataclasses.replace(item, values=values, optimal_cost=optima[entry.information_set]))
    least = np.concatenate(costs[CLAIRVOYANT]) if clairvoyant else None
    return Contest(scenario, parts[0].scored, outcomes, causal_bound(scenario), least, oracles)


def oracle_labels(scenario: Scenario) -> tuple[str, ...]:
    """The oracles of a scenario: with `lqg`, and where the winch has limits also with `mpc`."""
    return ("oracle", "oracle_mpc") if scenario.winch.is_limited else ("oracle",)


def _joined(parts: list[Trajectory]) -> Trajectory:
    first = parts[0]
    if len(parts) == 1:
        return first
    return dataclasses.replace(
        first,
        seeds=tuple(seed for item in parts for seed in item.seeds),
        states={name: np.concatenate([item.states[name] for item in parts], axis=1) for name in first.states},
        steps={name: np.concatenate([item.steps[name] for item in parts], axis=1) for name in first.steps},
        n_valid=np.concatenate([item.n_valid for item in parts]),
        outcomes={name: np.concatenate([item.outcomes[name] for item in parts]) for name in first.outcomes},
    )


def default_reference(labels: Sequence[str]) -> str:
    """The controller that differences are taken from unless one is named: `lqg`, or else the first."""
    return "lqg" if "lqg" in labels else labels[0]


def check_contest(scenarios: Sequence[Scenario], n_seeds: int) -> None:
    """Refuses what cannot be compared.

    Raises:
        ValueError: If there are no scenarios or no seas, or two scenarios have one name.
    """
    if n_seeds < 1:
        raise ValueError(f"seeds must be at least 1, got {n_seeds}")
    names = [scenario.name for scenario in scenarios]
    if not names:
        raise ValueError("no scenario was named; list them with heave scenarios list")
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"scenario {name!r} is named twice; give each a name of its own")


def compare(
    scenarios: Sequence[Scenario],
    controllers: Sequence[str],
    *,
    n_seeds: int,
    out: str | Path,
    duration: float | None = None,
    warm_up: float | None = None,
    dtype: str = "float64",
    reference: str | None = None,
    allow_other_scenario: bool = False,
    clairvoyant: bool = False,
    oracle: bool = False,
    arguments: list[str] | None = None,
    progress: Callable[[str, str, int, int], None] | None = None,
) -> Path:
    """Compares controllers in the first test seas of each scenario and writes the folder.

    Each controller's part is kept in the folder as it is finished, and the same call goes on from there; the
    results are written when everything has run.

    Args:
        scenarios: The operations, of distinct names.
        controllers: Names of designs, `agent:RUN` and `zoo:NAME` for trained agents, `file:PATH.py` for those
            of others.
        n_seeds: Number of test seas.
        out: Folder for the files; a former comparison there is replaced.
        duration: Length of the episodes [s]; None: the scenario's, but no more than the protocol needs.
        warm_up: Time left out at the start [s]; None: the protocol's.
        dtype: Precision of the plant.
        reference: Controller that paired differences are taken from; None: `default_reference`.
        allow_other_scenario: Whether an agent may act in a scenario it was not trained for.
        clairvoyant: Whether the yardstick that knows each sea beforehand is worked out, seconds for each sea.
        oracle: Whether the yardstick that knows what each episode draws runs too.
        arguments: Command line of the provenance; None: the process's own.
        progress: Called with scenario, label, steps done since the last call and steps in all.

    Returns:
        The folder.

    Raises:
        ValueError: If anything asked for is impossible.
    """
    out = runs.check_folder(out, runs.COMPARISON)
    specs = check_specs(controllers)
    check_contest(scenarios, n_seeds)
    labels = labels_of(specs)
    chosen = default_reference(list(labels.values()))
    if reference is not None:
        chosen = labels.get(reference, reference)
    if chosen not in labels.values():
        raise ValueError(f"reference {reference!r} is not among the controllers {', '.join(labels.values())}")
    seeds = range(FIRST_TEST_SEED, FIRST_TEST_SEED + n_seeds)

    for scenario in scenarios if clairvoyant else ():
        if not scenario.is_linear:
            raise ValueError(
                f"the clairvoyant yardstick takes a linear payload, scenario {scenario.name!r} has "
                "a cable; leave --clairvoyant out"
            )
    for scenario in scenarios if oracle else ():
        if not scenario.uncertainty:
            raise ValueError(
                f"the oracle yardstick takes a scenario whose episodes draw parameters, and "
                f"{scenario.name!r} has no uncertainty; leave --oracle out"
            )
    prepared = []
    for scenario in scenarios:
        entries = [
            entry_of(labels[spec], spec, scenario, allow_other_scenario=allow_other_scenario)
            for spec in specs
        ]
        timed = with_duration(scenario, protocol_duration(scenario) if duration is None else duration)
        window(timed.duration, timed.control_dt, warm_up)
        prepared.append((timed, entries))

    contests = []
    for scenario, entries in prepared:
        total = scenario.n_steps * n_seeds

        def report(label: str, count: int, name: str = scenario.name, total: int = total) -> None:
            if progress is not None:
                progress(name, label, count, total)

        contests.append(
            run_contest(
                scenario,
                entries,
                seeds,
                warm_up=warm_up,
                dtype=dtype,
                clairvoyant=clairvoyant,
                oracle=oracle,
                folder=out,
                progress=report,
            )
        )
    write_contests(out, contests, seeds, dtype, chosen, provenance(arguments))
    from experiments.report import write_report

    write_report(out)
    return out


def protocol_duration(scenario: Scenario) -> float:
    """The protocol's length of an episode [s], or the scenario's own if that is shorter."""
    protocol = round((WARM_UP + SCORED) / scenario.control_dt) * scenario.control_dt
    return min(scenario.duration, protocol)
