"""The zoo: trained agents that are shipped, as files that load without torch and without executing code.

An agent is a folder: `card.json`, which says what it is, how it was trained and what it was found to do, and
for each training seed a folder with that training's best policy, its weights rounded to half precision. The
card holds the hash of every policy's JSON (which holds that of its weights), of the weights as trained, and
its own. `zoo:NAME` is an agent with all its trainings, `zoo:NAME/SEED` one of them; `docs/zoo.md` describes
all of it.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import json
import os
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents.policy import POLICY_FILE, TrainedPolicy, canonical, load_policy, packed, seen_by, sha256
from agents.presets import Preset
from heave_env import scenarios
from heave_env.files import write_atomic
from heave_env.parameters import name_hint
from heave_env.scenarios import Scenario

PREFIX = "zoo:"
"""What stands before an agent's name where a run folder may stand too."""
FOLDER = Path(os.environ.get("HEAVE_ZOO") or Path(__file__).parent / "zoo")
"""Where the agents lie, a folder for each: within this package, or where the variable HEAVE_ZOO says."""
CARD_FILE = "card.json"
"""What describes an agent, in its folder."""
CARD_FORMAT = "heave_env zoo card 1"
"""What a card says it is."""
LARGEST = 5_000_000
"""All files of the zoo together are smaller than this [bytes]."""
PRECISION = np.float16
"""What weights are rounded to in the zoo's files; agents act in float32."""
RECIPE = ("kind", "algorithm", "scenario_name", "fingerprint", "scenario", "preset")
"""Entries of a run's `run.json` that all trainings of an agent have in common."""
CURVE = ("step", "wall_s", "cost_mean")
"""Columns of a run's `evaluations.csv` that the card keeps."""
_NAME = re.compile(r"[a-z0-9_]+(-[a-z0-9_]+)*")
_WEIGHTS_FILE = Path(POLICY_FILE).with_suffix(".safetensors").name


@dataclass(frozen=True)
class ZooAgent:
    """An agent of the zoo, as its card describes it."""

    name: str
    folder: Path
    """Where its files lie."""
    card: Mapping[str, Any]
    """The whole card, whose hash was right."""

    @property
    def scenario(self) -> Scenario:
        """The operation that it was trained for, as it is registered by name."""
        return scenarios.load(str(self.card["scenario_name"]))

    @property
    def seeds(self) -> tuple[int, ...]:
        """Training seeds, ascending."""
        return tuple(sorted(int(seed) for seed in self.card["trainings"]))

    @property
    def best(self) -> int:
        """Seed of the training that costs least on the validation seas of the trainings."""
        return min(self.seeds, key=lambda seed: (self.training(seed)["best"]["cost_mean"], seed))

    @property
    def size(self) -> int:
        """All its files together [bytes]."""
        files = [self.folder / CARD_FILE]
        for seed in self.seeds:
            files += [self.folder / str(seed) / name for name in (POLICY_FILE, _WEIGHTS_FILE)]
        return sum(path.stat().st_size for path in files if path.is_file())

    def training(self, seed: int) -> Mapping[str, Any]:
        """What the card says of one training.

        Raises:
            ValueError: If there is none of that seed.
        """
        if seed not in self.seeds:
            known = ", ".join(str(known) for known in self.seeds)
            raise ValueError(f"zoo agent {self.name!r} has no training of seed {seed}; seeds: {known}")
        found: Mapping[str, Any] = self.card["trainings"][str(seed)]
        return found

    def specs(self) -> tuple[str, ...]:
        """`zoo:NAME/SEED` of every training."""
        return tuple(f"{PREFIX}{self.name}/{seed}" for seed in self.seeds)

    def policy_folder(self, seed: int) -> Path:
        """The folder of one training's policy, whose hash is the card's.

        Raises:
            ValueError: If there is none of that seed, or its file is missing or another one.
        """
        path = self.folder / str(seed) / POLICY_FILE
        stated = self.training(seed)["policy_sha256"]
        try:
            content = path.read_bytes()
        except OSError as error:
            raise ValueError(f"zoo policy {str(path)!r} is missing; restore it") from error
        if sha256(content) != stated:
            raise ValueError(
                f"zoo policy {str(path)!r} does not have the hash that its card states: it is cut short or "
                "changed; restore it"
            )
        return path.parent

    def command(self, seed: int | None = None) -> str:
        """The command that trains it again; SEED and DIR stand for what is to be chosen."""
        return (
            f"heave train {self.card['scenario_name']} --algorithm {self.card['algorithm']} "
            f"--preset {PREFIX}{self.name} --seed {'SEED' if seed is None else seed} --out DIR"
        )


def names() -> tuple[str, ...]:
    """Names of the agents, in order."""
    return tuple(sorted(path.parent.name for path in FOLDER.glob(f"*/{CARD_FILE}")))


def read(name: str) -> ZooAgent:
    """An agent by its name.

    Raises:
        ValueError: If there is none, or its card is damaged.
    """
    path = FOLDER / name / CARD_FILE
    if not _NAME.fullmatch(name) or not path.is_file():
        hint = name_hint(name, names(), "list them with heave zoo list")
        raise ValueError(f"there is no agent {name!r} in the zoo; {hint}")
    try:
        card = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"zoo card {str(path)!r} is cut short or damaged: {error}; restore it") from error
    if not isinstance(card, dict) or card.get("format") != CARD_FORMAT:
        raise ValueError(f"{str(path)!r} is not a card of the format {CARD_FORMAT!r}; restore it")
    stated = card.pop("card_sha256", None)
    if stated != sha256(canonical(card)):
        raise ValueError(f"zoo card {str(path)!r} was changed; restore it")
    if card["name"] != name:
        raise ValueError(f"zoo card {str(path)!r} is of the agent {card['name']!r}; restore it")
    return ZooAgent(name, path.parent, card)


def _parts(spec: str) -> tuple[str, int | None]:
    """Name and, if one is given, seed of `zoo:NAME` or `zoo:NAME/SEED`."""
    name, slash, seed = spec.removeprefix(PREFIX).partition("/")
    if not name or (slash and not seed.isdigit()):
        raise ValueError(
            f"{spec!r} names no agent of the zoo; write zoo:NAME, or zoo:NAME/SEED for one training"
        )
    return name, int(seed) if slash else None


def specs_of(spec: str) -> tuple[str, ...]:
    """`zoo:NAME/SEED` of every training that a `zoo:NAME` or `zoo:NAME/SEED` means.

    Raises:
        ValueError: If there is no such agent or training, or its card is damaged.
    """
    name, seed = _parts(spec)
    agent = read(name)
    if seed is None:
        return agent.specs()
    agent.training(seed)
    return (f"{PREFIX}{name}/{seed}",)


def policy_folder(spec: str) -> Path:
    """The folder of the policy that a `zoo:NAME/SEED` names; of `zoo:NAME`, of the best training.

    Raises:
        ValueError: If there is no such agent or training, or a file of it is missing or changed.
    """
    name, seed = _parts(spec)
    agent = read(name)
    return agent.policy_folder(agent.best if seed is None else seed)


def load_agent(
    spec: str, scenario: Scenario | None = None, *, allow_other_scenario: bool = False
) -> TrainedPolicy:
    """An agent of the zoo as a controller; see `agents.policy.load_policy`.

    Args:
        spec: `zoo:NAME/SEED`, or `zoo:NAME` for the training that costs least on validation seas.
        scenario: The scenario it is to act in; None to take the one it was trained in.
        allow_other_scenario: Whether another scenario will do if its observations are laid out alike.

    Raises:
        ValueError: If there is no such agent, its files are damaged, or it belongs to another scenario.
    """
    try:
        return load_policy(policy_folder(spec), scenario, allow_other_scenario=allow_other_scenario)
    except ValueError as error:
        if scenario is None or "was trained in scenario" not in str(error):
            raise
        raise ValueError(
            f"agent {PREFIX}{spec.removeprefix(PREFIX)} was trained in scenario "
            f"{read(_parts(spec)[0]).card['scenario_name']!r}, not in this {scenario.name!r} (fingerprint "
            f"{scenario.fingerprint}): choose another agent, or allow another scenario"
        ) from error


def preset_of(spec: str) -> dict[str, Any]:
    """The settings that an agent was trained with, as `agents.train.train` takes them for a preset.

    Raises:
        ValueError: If there is no such agent, or its card is damaged.
    """
    preset = dict(read(_parts(spec)[0]).card["preset"])
    preset.pop("algorithm", None)
    return preset


# Adding ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """A finished training's folder, as far as the zoo takes it."""

    folder: Path
    content: Mapping[str, Any]
    """Its `run.json`."""
    policy: TrainedPolicy

    @property
    def seed(self) -> int:
        """The training's seed."""
        return int(self.content["seed"])

    @property
    def recipe(self) -> dict[str, Any]:
        """What all trainings of an agent have in common."""
        return {key: self.content[key] for key in RECIPE}

    @property
    def kind(self) -> str:
        """Mode of its guide, or `sensors` without one, or if it does not see what that estimates."""
        guide = self.policy.card.get("guide")
        shown = self.content["preset"].get("guide_shown", True)
        return str(guide["mode"]) if guide and shown else "sensors"


def read_run(folder: str | Path) -> Run:
    """A training's folder that may enter the zoo.

    Raises:
        ValueError: If it is no finished training, its policy is damaged, or its scenario is none by name.
    """
    folder = Path(folder)
    path = folder / "run.json"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(
            f"{str(folder)!r} is no run folder that heave train has written ({error})"
        ) from error
    missing = [
        key for key in (*RECIPE, "seed", "status") if not isinstance(content, dict) or key not in content
    ]
    if missing:
        raise ValueError(f"{str(path)!r} lacks {missing[0]!r}: it is of no training")
    if content["kind"] != "training":
        raise ValueError(
            f"{str(folder)!r} holds a {content['kind']}: the zoo takes what heave train has trained"
        )
    if content["status"] != "finished" or not content.get("best"):
        raise ValueError(
            f"the training in {str(folder)!r} is {content['status']}, not finished: the same command goes on"
        )
    policy = load_policy(folder)
    run = Run(folder, content, policy)
    told = policy.card.get("training", {})
    if told.get("seed") != run.seed or policy.card.get("fingerprint") != content["fingerprint"]:
        raise ValueError(f"the policy in {str(folder)!r} is not of the training that its run.json tells of")
    name = str(content["scenario_name"])
    if name not in scenarios.names():
        raise ValueError(
            f"{str(folder)!r} was trained in {name!r}, which is no scenario by name: it has no page"
        )
    try:
        load_policy(folder, scenarios.load(name))
    except ValueError as error:
        raise ValueError(
            f"{str(folder)!r} was trained in a changed {name!r} (fingerprint {content['fingerprint']}, by "
            f"name {seen_by(policy, scenarios.load(name)).fingerprint}): train it in the scenario as it is"
        ) from error
    return run


def add(run_folders: Sequence[str | Path], name: str | None = None) -> ZooAgent:
    """Takes finished trainings of one recipe into the zoo, as a new agent or further seeds of one.

    The card is written last: what it does not name is not in the zoo.

    Args:
        run_folders: Folders of trainings that differ in the seed alone.
        name: The agent's name; None: its scenario and kind, as `limits_linear-rate`.

    Returns:
        The agent, with its new card.

    Raises:
        ValueError: If the runs are not of one recipe, or not of the agent's, a seed is there already, or the
            zoo would grow too large.
    """
    zoo = FOLDER
    if not run_folders:
        raise ValueError("no run folder was named; name what heave train has written")
    found = [read_run(path) for path in run_folders]
    first = found[0]
    name = f"{first.content['scenario_name']}-{first.kind}" if name is None else name
    if not _NAME.fullmatch(name):
        raise ValueError(f"an agent's name is of a-z, 0-9 and _, in parts joined by -, got {name!r}")
    for run in found:
        _require_same(run, first.recipe, f"that in {str(first.folder)!r}")
        if [other.seed for other in found].count(run.seed) > 1:
            raise ValueError(f"two of the runs have the training seed {run.seed}: name one of them")
    zoo.mkdir(parents=True, exist_ok=True)
    with _sole_writer(zoo):
        if (zoo / name / CARD_FILE).exists():
            agent = read(name)
            for run in found:
                _require_same(run, {key: agent.card[key] for key in RECIPE}, f"agent {name!r} in the zoo")
                if run.seed in agent.seeds:
                    raise ValueError(f"agent {name!r} has a training of seed {run.seed} already; it was kept")
            card = dict(agent.card)
        else:
            guide = first.policy.card.get("guide")
            card = {
                "format": CARD_FORMAT,
                "name": name,
                "agent": first.kind,
                "guide": None if guide is None else str(guide["controller"]),
                "information_set": first.policy.information_set,
                **first.recipe,
                "trainings": {},
                "results": None,
            }
        card["trainings"] = dict(card["trainings"])
        files = {
            run.seed: dict(
                zip((POLICY_FILE, _WEIGHTS_FILE), packed(run.policy, _WEIGHTS_FILE, PRECISION), strict=True)
            )
            for run in found
        }
        new = sum(len(content) for both in files.values() for content in both.values())
        total = new + sum(path.stat().st_size for path in zoo.rglob("*") if path.is_file())
        if total >= LARGEST:
            raise ValueError(
                f"with {name!r} the zoo would hold {total / 1e6:.2f} MB, more than its {LARGEST / 1e6:g} MB: "
                "leave an agent or a seed out"
            )
        for run in found:
            place = zoo / name / str(run.seed)
            place.mkdir(parents=True, exist_ok=True)
            for file, content in files[run.seed].items():
                write_atomic(place / file, content)
            load_policy(place)
            card["trainings"][str(run.seed)] = _training(run, files[run.seed][POLICY_FILE])
        return _written(zoo, card)


def remember_results(name: str, results: Mapping[str, Any]) -> ZooAgent:
    """Puts what an agent was found to do on its card.

    Raises:
        ValueError: If there is no such agent, or its card is damaged.
    """
    zoo = FOLDER
    with _sole_writer(zoo):
        return _written(zoo, {**read(name).card, "results": dict(results)})


def _training(run: Run, policy: bytes) -> dict[str, Any]:
    """What a card says of a training."""
    content = run.content
    with (run.folder / "evaluations.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {
        "steps": content["steps"],
        "wall_s": content["wall_s"],
        "started": content.get("started"),
        "finished": content.get("finished"),
        "command": _anywhere(content.get("command")),
        "commit": content.get("commit"),
        "versions": content.get("versions"),
        "start": content.get("start"),
        "best": content["best"],
        "imitation": content.get("imitation"),
        "guide": run.policy.card.get("guide"),
        "curve": {name: [float(row[name]) for row in rows] for name in CURVE},
        "policy_sha256": sha256(policy),
        "weights_sha256": sha256(_bytes(run.folder / _WEIGHTS_FILE)),
    }


def _anywhere(command: str | None) -> str | None:
    """A training's command without where its folder lay on the machine that trained it."""
    if command is None:
        return None
    words = shlex.split(command)
    for place, word in enumerate(words[:-1]):
        if word == "--out":
            words[place + 1] = f"runs/{Path(words[place + 1]).name}"
    return shlex.join(words)


def _require_same(run: Run, recipe: Mapping[str, Any], other: str) -> None:
    difference = _difference("", _comparable(run.recipe), _comparable(recipe))
    if difference is not None:
        raise ValueError(
            f"the training in {str(run.folder)!r} is of another recipe than {other}: its {difference}; give "
            "it another --name"
        )


def _comparable(recipe: Mapping[str, Any]) -> dict[str, Any]:
    """A recipe as it is compared: settings that a training is too old to name are at their defaults.

    The scenario is known by its fingerprint, for the same reason.
    """
    defaults = {
        field.name: field.default
        for field in dataclasses.fields(Preset)
        if field.default is not dataclasses.MISSING
    }
    preset = json.loads(json.dumps({**defaults, **recipe["preset"]}))
    return {key: value for key, value in recipe.items() if key != "scenario"} | {"preset": preset}


def _difference(key: str, ours: Any, theirs: Any) -> str | None:
    """Where two settings differ, by the innermost key; None if they do not."""
    if ours == theirs:
        return None
    if isinstance(ours, Mapping) and isinstance(theirs, Mapping):
        for inner in sorted({*ours, *theirs}):
            found = _difference(f"{key}.{inner}".strip("."), ours.get(inner), theirs.get(inner))
            if found is not None:
                return found
    return f"{key} is {ours!r}, not {theirs!r}"


def _written(zoo: Path, card: dict[str, Any]) -> ZooAgent:
    name = str(card["name"])
    card = json.loads(canonical(card))
    card["trainings"] = dict(sorted(card["trainings"].items(), key=lambda item: int(item[0])))
    text = json.dumps({**card, "card_sha256": sha256(canonical(card))}, indent=1) + "\n"
    write_atomic(zoo / name / CARD_FILE, text.encode())
    return read(name)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ValueError(f"cannot read {str(path)!r}: {error.strerror}") from error


@contextlib.contextmanager
def _sole_writer(zoo: Path) -> Iterator[None]:
    """Waits until no other process writes a card; the system lets go of it when the process ends."""
    try:
        import fcntl
    except ImportError:  # not on this system
        yield
        return
    handle = os.open(zoo, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
