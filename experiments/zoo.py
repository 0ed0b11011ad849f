"""What the agents of the zoo do on validation seas beside their rivals: the results on their cards.

The seas are validation seas on which nothing was chosen, neither a policy nor a setting. The files are
`agents.zoo`'s.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from agents import zoo
from agents.zoo import ZooAgent
from experiments.compare import entry_of, protocol_duration
from experiments.evaluate import contested
from experiments.leaderboard import Cell, Quantity, Result, quantities
from experiments.report import significant
from experiments.results import Entry
from experiments.rollout import with_duration
from heave_env.provenance import commit
from heave_env.scenarios import Scenario

FIRST_CARD_SEED = 10_100_000
"""Validation seas that chose nothing have the seeds from here, as for the card of a training."""
N_SEAS = 64
"""Validation seas that the results are of, unless asked otherwise [-]."""
WORK = Path("runs") / "zoo"
"""Where finished parts are kept, so that rivals run once for all agents of a scenario."""
CARD_QUANTITIES = (
    "cost",
    "cost_median",
    "cost_p95",
    "cost_maximum",
    "payload_heave_std",
    "control_energy",
    "saturation_fraction",
    "winch_work",
    "tension_peak",
    "tension_peak_maximum",
    "tension_p999",
    "cost_ratio_to_optimum",
    "diverged",
    "lost",
    "decision_time",
)
"""Numbers of everybody that a card holds, where there are any."""


def rivals_of(scenario: Scenario) -> tuple[str, ...]:
    """The strongest designed controllers of a scenario, as far as they can be designed for it."""
    found = ["lqg"]
    if scenario.winch.is_limited:
        found.append("mpc")
    if scenario.task.energy_weight > 0.0:
        found.append("mpc_l1")
    if scenario.uncertainty:
        found += ["multi_model", *(["multi_model_mpc"] if scenario.winch.is_limited else [])]
    return tuple(found)


def measure(
    agent: ZooAgent,
    *,
    n_seas: int = N_SEAS,
    duration: float | None = None,
    rivals: Sequence[str] | None = None,
    work: Path = WORK,
    progress: Callable[[str, str, int, int], None] | None = None,
) -> ZooAgent:
    """Runs an agent and its rivals in validation seas and puts the results on its card.

    Args:
        agent: The agent.
        n_seas: Validation seas.
        duration: Length of the episodes [s]; None: the protocol's.
        rivals: Designed controllers that it is held against; None: `rivals_of`.
        work: Folder in which finished parts are kept.
        progress: Called with scenario, label, steps done since the last call and steps in all.

    Returns:
        The agent with its new card.

    Raises:
        ValueError: If a rival cannot be designed, or a file of the agent is damaged.
    """
    from agents.policy import load_policy

    if n_seas < 2:
        raise ValueError(f"results take at least 2 seas, got {n_seas}")
    scenario = agent.scenario
    timed = with_duration(scenario, protocol_duration(scenario) if duration is None else duration)
    own = []
    for seed, spec in zip(agent.seeds, agent.specs(), strict=True):
        policy = load_policy(agent.policy_folder(seed), scenario)
        own.append(Entry(spec, spec, policy, policy.information_set))
    entries: dict[str, list[Entry]] = {agent.name: own}
    for rival in rivals_of(scenario) if rivals is None else rivals:
        entries[rival] = [entry_of(rival, rival, scenario)]
        if progress is not None:
            progress(scenario.name, "designs", 1, len(entries))
    seeds = range(FIRST_CARD_SEED, FIRST_CARD_SEED + n_seas)
    oracle = bool(scenario.uncertainty)
    cell = contested(timed, entries, seeds, oracle=oracle, folder=work, progress=progress)
    return zoo.remember_results(agent.name, _results(agent, cell, seeds))


def _results(agent: ZooAgent, cell: Cell, seeds: range) -> dict[str, Any]:
    """What a card holds of a contest between an agent and its rivals."""
    rivals = [name for name in cell.results if name != agent.name]
    oracles = list(cell.contest.oracles)
    result = cell.results[agent.name]

    def row(training: Result | None) -> dict[str, Any]:
        # Ratios to oracles are there whoever the reference is.
        found = {rival: quantities(cell, agent.name, rival, training) for rival in (*rivals, agent.name)}
        ratios = {rival: found[rival][f"cost_ratio_to_{rival}"] for rival in rivals}
        ratios |= {name: found[agent.name][f"cost_ratio_to_{name}"] for name in oracles}
        return _numbers(found[agent.name]) | {"ratios": {name: _plain(item) for name, item in ratios.items()}}

    part = cell.contest.part
    return {
        "first_sea": seeds.start,
        "n_seas": len(seeds),
        "warm_up": part.warm_up,
        "scored": part.scored,
        "commit": commit(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "agent": row(None),
        "trainings": {str(seed): row(result.training(i)) for i, seed in enumerate(agent.seeds)},
        "rivals": {rival: _numbers(quantities(cell, rival, rival)) for rival in rivals},
    }


def _numbers(found: Mapping[str, Quantity]) -> dict[str, Any]:
    return {name: _plain(found[name]) for name in CARD_QUANTITIES if name in found}


def _plain(item: Quantity) -> dict[str, Any]:
    found = {"value": item.value, "unit": item.unit}
    return found if item.low is None else found | {"low": item.low, "high": item.high}


def ratios_text(agent: ZooAgent) -> str:
    """The agent's mean cost over that of its rivals, the worst training beside all: `0.82 (0.84) of lqg`."""
    results = agent.card["results"]
    if not results:
        return "not measured: heave zoo measure " + agent.name
    told = []
    for rival, ratio in results["agent"]["ratios"].items():
        worst = max(row["ratios"][rival]["value"] for row in results["trainings"].values())
        told.append(f"{ratio['value']:.3f} ({worst:.3f}) of {rival}")
    optimum = results["agent"].get("cost_ratio_to_optimum")
    told += [f"{optimum['value']:.3f} of the optimum"] if optimum else []
    missing = len(agent.seeds) - len(results["trainings"])
    return ", ".join(told) + (f"; {missing} trainings not measured" if missing else "")


def card_lines(agent: ZooAgent) -> list[str]:
    """The card as lines of text, with the command that trains the agent again."""
    card, results = agent.card, agent.card["results"]
    guide = f", beside {card['guide']}" if card["guide"] else ""
    sees = card["information_set"].replace("_", " ")
    lines = [
        f"{agent.name}: {card['algorithm']} {card['agent']}{guide}, sees {sees}",
        f"scenario: {card['scenario_name']} (fingerprint {card['fingerprint']})",
        f"train it again: {agent.command()}",
        f"evaluate it: heave evaluate zoo:{agent.name}",
        f"size: {agent.size / 1e3:.0f} kB in {agent.folder}",
        "",
    ]
    for seed in agent.seeds:
        training = agent.training(seed)
        best = training["best"]
        lines.append(
            f"seed {seed}: {training['steps']} steps in {training['wall_s']:.0f} s, best at step "
            f"{best['step']:.0f} with J {best['cost_mean']:.4g} as the training validates it; "
            f"finished {training['finished']}, commit {training['commit']}, "
            f"policy {training['policy_sha256'][:16]}, weights {training['weights_sha256'][:16]}"
        )
    versions = {json.dumps(agent.training(seed)["versions"]) for seed in agent.seeds}
    for text in sorted(versions):
        lines.append("versions: " + ", ".join(f"{name} {found}" for name, found in json.loads(text).items()))
    lines.append("")
    if not results:
        return [*lines, f"not measured: heave zoo measure {agent.name}"]
    lines.append(
        f"{results['n_seas']} validation seas from seed {results['first_sea']}, {results['scored']:g} s "
        f"after {results['warm_up']:g} s; commit {results['commit']}, {results['date']}"
    )
    rows = {agent.name: results["agent"]}
    rows |= {f"  seed {seed}": row for seed, row in results["trainings"].items()}
    for name, row in (rows | results["rivals"]).items():
        lines.append(f"  {name}: {_told(row)}")
    return lines


def _told(row: Mapping[str, Any]) -> str:
    """What a card holds of one, in a line."""

    def number(name: str, factor: float = 1.0) -> str:
        item = row[name]
        text = significant(factor * item["value"], 4)
        if "low" not in item:
            return text
        return f"{text} ({significant(factor * item['low'], 4)} to {significant(factor * item['high'], 4)})"

    told = [f"J {number('cost')}, median {number('cost_median')}, maximum {number('cost_maximum')}"]
    told.append(f"payload std {number('payload_heave_std', 1e3)} mm")
    told.append(f"control energy {number('control_energy')} m²")
    if "winch_work" in row:
        told.append(f"winch work {number('winch_work', 1e-6)} MJ")
    if "tension_peak" in row:
        told.append(f"peak tension {number('tension_peak', 1e-3)} kN")
    failed = row["diverged"]["value"] + row["lost"]["value"]
    told.append(f"{failed} seas failed")
    for rival, ratio in row.get("ratios", {}).items():
        ends = f" ({ratio['low']:.3f} to {ratio['high']:.3f})" if "low" in ratio else ""
        told.append(f"{ratio['value']:.3f}{ends} of {rival}")
    if "cost_ratio_to_optimum" in row:
        told.append(f"{row['cost_ratio_to_optimum']['value']:.4f} of the optimum")
    return "; ".join(told)
