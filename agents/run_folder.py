"""The folder of a training: what describes it, who may write into it, its curves and its card."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import shutil
import signal
import threading
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import KVWriter, TensorBoardOutputFormat

from heave_env.files import write_atomic
from heave_env.provenance import commit, versions

RUN_FILE = "run.json"
"""What describes a run, in its folder."""
STATE_FOLDER = "resume"
"""Where the state to go on from lies while a training is not finished."""
LESSONS_FOLDER = "lessons"
"""Where an imitation keeps its rounds while a training is not finished."""
CARD_FILE = "card.md"
"""What a finished run came to, to be read."""
_LOCK_FILE = ".lock"


class FolderInUse(ValueError):
    """Another process works in the folder."""


class Run:
    """A training's folder and the JSON that describes it."""

    def __init__(self, folder: Path, content: dict[str, Any]) -> None:
        self.folder, self.content = folder, content

    @classmethod
    def opened(cls, folder: Path, identity: Mapping[str, Any], command: str) -> Run:
        """The run in a folder, or a new one.

        Args:
            folder: Where it lies.
            identity: What decides its result.
            command: Which command or call began it, if it is new.

        Raises:
            ValueError: If the folder holds another training, or something else.
        """
        path = folder / RUN_FILE
        if not path.exists():
            # Hidden are the lock, and drafts that a killed process left.
            strangers = [entry.name for entry in folder.iterdir() if not entry.name.startswith(".")]
            if strangers:
                raise ValueError(
                    f"{str(folder)!r} holds files but no run ({min(strangers)!r}, ...): choose another folder"
                )
            # Written once the training stands: settings that do not work leave no run behind.
            origin = {"command": command, "started": now(), "versions": dict(versions()), "commit": commit()}
            return cls(folder, {**identity, "status": "new", "steps": 0, "wall_s": 0.0, **origin})
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ValueError(
                f"cannot read {str(path)!r} ({error}): delete the folder or choose another"
            ) from error
        for key, value in identity.items():
            if content.get(key) != value:
                difference = _difference(key, content.get(key), value)
                raise ValueError(
                    f"{str(folder)!r} holds another training: its {difference}; "
                    "choose another folder or repeat its settings"
                )
        return cls(folder, content)

    @property
    def state_folder(self) -> Path:
        """Where the state to go on from lies."""
        return self.folder / STATE_FOLDER

    @property
    def lessons_folder(self) -> Path:
        """Where an imitation keeps its rounds."""
        return self.folder / LESSONS_FOLDER

    def update(self, **changes: Any) -> None:
        """Changes entries and writes the JSON."""
        self.content |= changes
        write_atomic(self.folder / RUN_FILE, (json.dumps(self.content, indent=1) + "\n").encode())

    def finish(
        self,
        *,
        steps: int,
        wall_s: float,
        evaluations: list[dict[str, float]],
        result: Mapping[str, float],
    ) -> None:
        """Writes the card and the end of the run, and drops what it would have gone on from.

        Args:
            steps: Environment steps.
            wall_s: Wall time [s].
            evaluations: Rows of `evaluations.csv`, the first of the start.
            result: How the kept policy does on seas that chose nothing.
        """
        best = min(evaluations, key=lambda row: row["cost_mean"])
        facts = {"steps": steps, "wall_s": wall_s, "finished": now()}
        facts |= {"start": evaluations[0], "best": best, "result": dict(result)}
        write_atomic(self.folder / CARD_FILE, card_of(self.content | facts).encode())
        self.update(status="finished", **facts)
        self.drop_state()

    def drop_state(self) -> None:
        """Removes what there would be to go on from: there is nothing left to do."""
        for folder in (self.state_folder, self.lessons_folder):
            if folder.exists():
                shutil.rmtree(folder)


@contextlib.contextmanager
def sole_user(folder: Path) -> Iterator[None]:
    """Holds the folder for this process; the system lets go of it when the process ends, however it does.

    Raises:
        FolderInUse: If another process holds it.
        ValueError: If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"cannot make the run folder {str(folder)!r}: {error.strerror}") from error
    try:
        import fcntl
    except ImportError:  # not on this system: two trainings in one folder are the user's own affair
        yield
        return
    with (folder / _LOCK_FILE).open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise FolderInUse(
                f"another process is training in {str(folder)!r}: wait for it or end it"
            ) from error
        yield


def _difference(key: str, theirs: Any, ours: Any) -> str:
    """Where two settings differ, by the innermost key."""
    if isinstance(theirs, dict) and isinstance(ours, dict):
        for inner in ours:
            if theirs.get(inner) != ours[inner]:
                return _difference(f"{key}.{inner}", theirs.get(inner), ours[inner])
    return f"{key} is {theirs!r}, not {ours!r}"


def now() -> str:
    """The time, as a run tells it."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def card_of(content: Mapping[str, Any]) -> str:
    """What a finished training came to, as a page of Markdown.

    Args:
        content: The run's JSON with its end: `steps`, `wall_s`, `finished`, `start`, `best`, `result`.
    """
    start, best, result, preset = (content[key] for key in ("start", "best", "result", "preset"))
    guide = content.get("guide")
    seen = preset["information_set"] or content["scenario"].get("information_set", "sensors")
    sees = seen.replace("_", " ")
    if guide is not None and preset.get("guide_shown", True):
        sees += f", and the estimate of {guide['controller']}"
    last = result["first_sea"] + result["n_seas"] - 1
    rows = {
        "command": f"`{content['command']}`",
        "commit": content["commit"],
        "scenario": f"{content['scenario_name']} (fingerprint {content['fingerprint']})",
        "sees": sees,
        "steps": f"{content['steps']:,}".replace(",", " "),
        "wall time [s]": f"{content['wall_s']:g}",
        "finished": content["finished"],
        "kept": f"the policy of step {best['step']:.0f}, best in the validation seas of `evaluations.csv`",
        "cost J there, at the start and kept": f"{start['cost_mean']:.4g}, {best['cost_mean']:.4g}",
        "validation seas of what follows": f"seeds {result['first_sea']} to {last}, which chose nothing; the "
        f"second half of {result['duration']:g} s",
        "cost J: mean, median, largest": ", ".join(
            f"{result[f'cost_{key}']:.4g}" for key in ("mean", "median", "max")
        ),
        "payload std [m]": f"{result['payload_heave_std']:.4g}",
        "command std [m]": f"{result['command_std']:.4g}",
        "seas in which the operation failed": f"{result['failed']:.0f}",
        "versions": ", ".join(f"{name} {version}" for name, version in content["versions"].items()),
    }
    title = f"# {content['algorithm']} on {content['scenario_name']}, seed {content['seed']}"
    lines = (f"| {name} | {value} |" for name, value in rows.items())
    return "\n".join([title, "", "| | |", "|---|---|", *lines]) + "\n"


class CurveFile(KVWriter):
    """The logged values as CSV, rewritten whole at each row, so that no kill leaves half a line."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: list[dict[str, float]] = []

    def write(
        self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0
    ) -> None:
        """Adds a row."""
        self.rows.append({key: float(value) for key, value in sorted(key_values.items())})
        columns: dict[str, None] = {}
        for row in self.rows:
            columns |= dict.fromkeys(row)
        text = io.StringIO()
        writer = csv.DictWriter(text, list(columns), lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.rows)
        write_atomic(self.path, text.getvalue().encode())

    def close(self) -> None:
        """Nothing is left open."""


def tensorboard(folder: Path) -> TensorBoardOutputFormat:
    return TensorBoardOutputFormat(str(folder / "tensorboard"))


@contextlib.contextmanager
def interrupt_flag() -> Iterator[threading.Event]:
    """An event that Ctrl-C or SIGTERM sets; a second Ctrl-C interrupts at once. Main thread only."""
    flag = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield flag
        return

    def handle(signum: int, frame: Any) -> None:
        if flag.is_set():
            raise KeyboardInterrupt
        flag.set()

    previous = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield flag
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
