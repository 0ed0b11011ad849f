"""`heave sweep`: trainings over scenarios, algorithms, kinds and seeds, and a search for settings.

Each training is an ordinary run folder, which goes on where it was interrupted. So nothing but these folders
and the search's SQLite file needs to be remembered: a worker, a node or the whole command may be killed at
any moment, and the same training is run again and comes to the same bits. The table is made from the folders.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import math
import os
import shutil
import socket
import tempfile
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments import runs
from experiments.processes import ONE_THREAD
from experiments.sweep_file import OPTION, Cell, Sweep, cells_of, check_search, read_sweep
from experiments.validate import source_hash
from heave_env.provenance import provenance

SWEEP = "sweep"
"""`kind` in the `run.json` of a sweep's folder."""
TABLE_FILE = "sweep.csv"
COLUMNS = (
    "scenario",
    "algorithm",
    "kind",
    "seed",
    "overrides",
    "trial",
    "steps",
    "wall_s",
    "validation_cost",
    "status",
    "path",
)
"""Columns of the table: a row for each training that finished or failed."""
RETRIES = 10
"""How often a training is run again after its worker or node has died."""
_GRACE = 60.0  # seconds that trainings have to save their state after Ctrl-C
_HAND_OVER = 120.0  # seconds to wait for a dying process to let go of its run folder
_OBJECT_STORE = 80 * 2**20  # bytes; Ray's least is 75 MiB, and what passes through it is a few kilobytes

FINISHED, DIVERGED, FAILED, INTERRUPTED = "finished", "diverged", "failed", "interrupted"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How one attempt at a training ended."""

    status: str
    """`finished`, `diverged` (weights or costs stopped being finite), `failed` or `interrupted`."""
    reason: str = ""
    """Why it did not finish."""
    cpu_s: float = 0.0
    """Processor time that it took [s]."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """What a sweep came to."""

    folder: Path
    rows: list[dict[str, Any]]
    """The table."""
    failures: dict[str, str]
    """Why trainings did not finish, by folder."""
    n_skipped: int
    """Trainings that were finished before [-]."""
    n_run: int
    """Trainings that were finished by this command [-]."""
    workers: int
    start_s: float
    """Time in which Ray was started [s]."""
    wall_s: float
    """Time from there to the end [s]."""
    cpu_s: float
    """Processor time of the trainings [s]."""
    best: dict[str, Any] | None
    """The search's best trial."""

    @property
    def speed(self) -> str:
        """How fast it was, in a line."""
        minutes = max(self.wall_s, 1e-9) / 60.0
        return (
            f"{self.n_run} trainings in {self.wall_s:.1f} s, {self.workers} at a time: "
            f"{self.n_run / minutes:.2f} per minute, {self.cpu_s:.1f} s of processor time, "
            f"{self.cpu_s / max(self.wall_s, 1e-9):.2f} cores kept busy; start {self.start_s:.1f} s"
        )


def sweep(
    file: str | Path,
    *,
    out: str | Path | None = None,
    address: str | None = None,
    workers: int | None = None,
    save_every: float = 20.0,
    arguments: Sequence[str] = (),
    progress: Callable[[float, int], None] | None = None,
) -> Summary:
    """Runs what a sweep file asks for, or what is left of it.

    Args:
        file: The YAML file.
        out: Folder for everything; `runs/` and the file's name if not given.
        address: Of a Ray cluster; None: a Ray of its own on this machine, ended afterwards.
        workers: Trainings at a time; the processors that Ray has if not given. One, without an address, is
            this process and needs no Ray.
        save_every: Seconds between saves of a training's state.
        arguments: The command line, for the record.
        progress: Called with trainings done since the last call, as a fraction, and trainings in all.

    Returns:
        What it came to.

    Raises:
        ValueError: If the file or an argument is impossible, or a package is missing.
        KeyboardInterrupt: When interrupted, after the trainings have saved their state.
    """
    from agents.run_folder import sole_user

    if workers is not None and workers < 1:
        raise ValueError(f"--workers must be at least 1, got {workers}")
    asked = read_sweep(file)
    try:
        cells = cells_of(asked)
        if asked.search is not None:
            check_search(asked.search, asked.steps)
    except ValueError as error:
        raise ValueError(f"{str(file)!r}: {error}") from error
    _require_packages(asked, in_process=workers == 1 and address is None)
    folder = runs.check_folder(out if out is not None else Path("runs") / Path(file).stem, SWEEP)
    with sole_user(folder):
        made = _identified(folder, file, arguments)
        began = time.monotonic()
        with _opened_pool(folder, address, workers, made["id"], save_every) as pool:
            started = time.monotonic()
            queue = _Queue(asked, cells, folder)
            progress = progress or (lambda count, total: None)
            try:
                cpu_s = _carry_out(queue, pool, progress)
            finally:
                rows = _write_table(folder, queue.known(), queue.failures)
        return Summary(
            folder=folder,
            rows=rows,
            failures=queue.failures,
            n_skipped=queue.n_skipped,
            n_run=queue.n_run,
            workers=pool.workers,
            start_s=started - began,
            wall_s=time.monotonic() - started,
            cpu_s=cpu_s,
            best=None if queue.study is None else queue.study.best,
        )


def _require_packages(asked: Sweep, *, in_process: bool) -> None:
    if not in_process and importlib.util.find_spec("ray") is None:
        raise ValueError(
            "several trainings at a time need the package 'ray': install heave-env[sweep] or give --workers 1"
        )
    if asked.search is not None and importlib.util.find_spec("optuna") is None:
        raise ValueError(
            "a search needs the package 'optuna': install heave-env[sweep], or remove the key 'search'"
        )


def _identified(folder: Path, file: str | Path, arguments: Sequence[str]) -> dict[str, Any]:
    """The folder's run file, with an identifier by which a distant worker knows that it sees this folder."""
    path = folder / runs.RUN_FILE
    held = runs.read_json(path) if path.exists() else {}
    made = {
        "kind": SWEEP,
        "id": held.get("id") or uuid.uuid4().hex,
        "file": Path(file).read_text(encoding="utf-8"),
        **provenance(list(arguments)),
    }
    runs.write_json(path, made)
    return made


# What is to be done ------------------------------------------------------------------------------


class _Queue:
    """The trainings that are left, and what became of the others."""

    def __init__(self, asked: Sweep, cells: Sequence[Cell], folder: Path) -> None:
        self.folder = folder
        self.cells = list(cells)
        self.waiting = deque(cells)
        self.study: Any = None
        self.n_total = len(cells)
        if asked.search is not None:
            from experiments.search import Study

            self.study = Study(asked.search, asked.steps, folder)
            self.n_total += asked.search.trials * len(asked.search.seeds)
            # Those of finished trials are not met again.
            self.n_met = len(self.study.cells()) - len(self.study.pending)
        else:
            self.n_met = 0
        self.n_skipped = self.n_met
        self.n_run = 0
        self.failures: dict[str, str] = {}

    def next(self) -> Cell | None:
        """The next training that is not finished; None if there is none to begin now."""
        while True:
            cell = self.waiting.popleft() if self.waiting else self.study.cell() if self.study else None
            if cell is None or not self._finished(cell):
                return cell
            self.n_skipped += 1
            self._settled(cell, FINISHED)

    def _finished(self, cell: Cell) -> bool:
        run = _run_of(self.folder, cell)
        return run.get("status") == FINISHED and run.get("preset") == cell.settings

    def ended(self, cell: Cell, outcome: Outcome) -> None:
        """Takes what became of a training."""
        if outcome.status == INTERRUPTED:  # by someone else, or by a node that was shut down: once more
            self.waiting.append(cell)
            return
        if outcome.status == FINISHED:
            self.n_run += 1
        else:
            self.failures[cell.folder] = outcome.reason
        self._settled(cell, outcome.status)

    def _settled(self, cell: Cell, status: str) -> None:
        self.n_met += 1
        if cell.trial is None:
            return
        if status == FINISHED:
            self.study.tell(cell, _run_of(self.folder, cell)["best"]["cost_mean"])
        elif status == DIVERGED:  # an answer of its own: not there
            self.study.tell(cell, math.inf)

    def known(self) -> list[Cell]:
        """Every training that is known by now."""
        return self.cells + (self.study.cells() if self.study is not None else [])


def _run_of(folder: Path, cell: Cell) -> dict[str, Any]:
    """What a training says of itself; nothing before it has begun."""
    try:
        content = json.loads((folder / cell.folder / runs.RUN_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _carry_out(queue: _Queue, pool: Any, progress: Callable[[float, int], None]) -> float:
    """Runs the queue empty; returns the trainings' processor time [s]."""
    cpu_s, shown = 0.0, 0.0
    running: list[Cell] = []
    while True:
        while len(running) < pool.workers and (cell := queue.next()) is not None:
            pool.submit(cell)
            running.append(cell)
        if not running:
            progress(queue.n_met - shown, queue.n_total)
            return cpu_s
        for cell, outcome in pool.ended():
            running.remove(cell)
            cpu_s += outcome.cpu_s
            queue.ended(cell, outcome)
            _write_table(queue.folder, queue.known(), queue.failures)
        part = sum(
            min(_run_of(queue.folder, cell).get("steps", 0) / cell.preset.total_steps, 1.0)
            for cell in running
        )
        if queue.n_met + part > shown:
            progress(queue.n_met + part - shown, queue.n_total)
            shown = queue.n_met + part


def _write_table(folder: Path, cells: Sequence[Cell], failures: dict[str, str]) -> list[dict[str, Any]]:
    rows = []
    for cell in cells:
        run = _run_of(folder, cell)
        finished = run.get("status") == FINISHED and run.get("preset") == cell.settings
        if not finished and cell.folder not in failures and run.get("status") != "failed":
            continue
        rows.append(
            {
                "scenario": cell.scenario.name,
                "algorithm": cell.algorithm,
                "kind": cell.kind,
                "seed": cell.seed,
                "overrides": json.dumps(cell.overrides, sort_keys=True) if cell.overrides else "",
                "trial": cell.trial,
                "steps": run.get("steps"),
                "wall_s": run.get("wall_s"),
                "validation_cost": run["best"]["cost_mean"] if finished else None,
                "status": FINISHED if finished else FAILED,
                "path": str(folder / cell.folder),
            }
        )
    runs.write_text(
        folder / TABLE_FILE, runs.table_text(COLUMNS, ([row[column] for column in COLUMNS] for row in rows))
    )
    return rows


def differing(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The overrides of each row of the table that it does not share with all others, in words."""
    everything = [_flat(json.loads(row["overrides"] or "{}")) for row in rows]
    if not rows:
        return []
    shared = set.intersection(
        *({(key, json.dumps(value)) for key, value in one.items()} for one in everything)
    )
    return [
        ", ".join(f"{key}={value}" for key, value in one.items() if (key, json.dumps(value)) not in shared)
        for one in everything
    ]


def _flat(overrides: dict[str, Any]) -> dict[str, Any]:
    options = {f"{OPTION}{key}": value for key, value in overrides.get("options", {}).items()}
    return {key: value for key, value in overrides.items() if key != "options"} | options


# One training ------------------------------------------------------------------------------------


def run_cell(task: dict[str, Any]) -> Outcome:
    """Trains one agent, or goes on with it, in whatever process this is.

    Args:
        task: `cell`, the sweep's absolute `folder` and `id`, the program's `source` hash (None: not
            compared), `save_every` [s] and whether to draw `progress`.
    """
    began = time.process_time()
    cell: Cell = task["cell"]

    def outcome(status: str, reason: str = "") -> Outcome:
        return Outcome(status=status, reason=reason, cpu_s=time.process_time() - began)

    folder = Path(task["folder"])
    if _identifier(folder) != task["id"]:
        return outcome(
            FAILED,
            f"a worker does not see {str(folder)!r}: on a cluster give --out a folder on a file system that "
            "all nodes share",
        )
    if task["source"] not in (None, source_hash()):
        return outcome(FAILED, "a worker has another version of the program: install the same on every node")
    from agents.train import TrainingFailure

    try:
        _train(cell, folder / cell.folder, task["save_every"], task["progress"])
    except TrainingFailure as error:
        return outcome(DIVERGED, str(error))
    except KeyboardInterrupt:
        if task["progress"]:  # in the command's own process
            raise
        return outcome(INTERRUPTED, "interrupted")
    except Exception as error:  # one bad training does not end the others
        said = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        return outcome(FAILED, said)
    return outcome(FINISHED)


def _train(cell: Cell, folder: Path, save_every: float, progress: bool) -> None:
    from agents.run_folder import FolderInUse
    from agents.train import train

    patience = time.monotonic() + _HAND_OVER
    while True:
        try:
            train(
                cell.scenario,
                algorithm=cell.algorithm,
                seed=cell.seed,
                out=folder,
                preset={key: value for key, value in cell.settings.items() if key != "algorithm"},
                progress=progress,
                save_every=save_every,
            )
            return
        except FolderInUse:  # the worker that was thought dead is still at it
            if time.monotonic() > patience:
                raise
            time.sleep(1.0)


def _identifier(folder: Path) -> str | None:
    try:
        found = json.loads((folder / runs.RUN_FILE).read_text(encoding="utf-8"))["id"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return str(found)


# Where trainings run -----------------------------------------------------------------------------


@contextlib.contextmanager
def _opened_pool(
    folder: Path, address: str | None, workers: int | None, identifier: str, save_every: float
) -> Iterator[_Here | _OnRay]:
    task = {
        "folder": str(folder.resolve()),
        "id": identifier,
        "source": None if address is None else source_hash(),  # here all run the same program
        "save_every": save_every,
        "progress": False,
    }
    if address is None and workers == 1:
        yield _Here(task)
        return
    with _ray(address, workers) as ray:
        pool = _OnRay(ray, task, workers or int(ray.cluster_resources().get("CPU", 1)))
        try:
            yield pool
        except KeyboardInterrupt:
            pool.interrupt()
            raise


class _Here:
    """Trainings one after another in this process."""

    workers = 1

    def __init__(self, task: dict[str, Any]) -> None:
        self.task = {**task, "progress": True}
        self.cells: deque[Cell] = deque()

    def submit(self, cell: Cell) -> None:
        """Takes a training."""
        self.cells.append(cell)

    def ended(self) -> list[tuple[Cell, Outcome]]:
        """Runs what was taken; how it ended."""
        cell = self.cells.popleft()
        return [(cell, run_cell({**self.task, "cell": cell}))]


class _OnRay:
    """Trainings as tasks of Ray, one processor each, run again when their worker or node dies."""

    def __init__(self, ray: Any, task: dict[str, Any], workers: int) -> None:
        self.ray, self.task, self.workers = ray, task, max(workers, 1)
        self.function = ray.remote(num_cpus=1, max_retries=RETRIES, retry_exceptions=False)(run_cell)
        self.cells: dict[Any, Cell] = {}

    def submit(self, cell: Cell) -> None:
        """Hands a training to Ray; its process is named after the run folder."""
        name = Path(cell.folder).name
        self.cells[self.function.options(name=name).remote({**self.task, "cell": cell})] = cell

    def ended(self) -> list[tuple[Cell, Outcome]]:
        """The trainings that ended within a second, and how."""
        ready, _ = self.ray.wait(list(self.cells), num_returns=1, timeout=1.0)
        return [(self.cells.pop(reference), self._outcome(reference)) for reference in ready]

    def _outcome(self, reference: Any) -> Outcome:
        try:
            found: Outcome = self.ray.get(reference)
        except self.ray.exceptions.TaskCancelledError:
            return Outcome(status=INTERRUPTED, reason="interrupted")
        except self.ray.exceptions.RayError as error:
            first = next((line for line in str(error).splitlines() if line.strip()), type(error).__name__)
            return Outcome(status=FAILED, reason=f"its worker was lost {RETRIES + 1} times: {first.strip()}")
        return found

    def interrupt(self) -> None:
        """Ends the trainings under way, once they have saved their state."""
        for reference in self.cells:
            self.ray.cancel(reference, force=False)
        if self.cells:
            self.ray.wait(list(self.cells), num_returns=len(self.cells), timeout=_GRACE)


@contextlib.contextmanager
def _ray(address: str | None, workers: int | None) -> Iterator[Any]:
    """A connection to Ray: to a cluster, or to one of our own that ends with it."""
    with _environment({"RAY_USAGE_STATS_ENABLED": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}):
        import ray

        quiet: dict[str, Any] = {"logging_level": "ERROR", "log_to_driver": False}
        if address is not None:
            _check_address(address)
            try:
                ray.init(address=address, **quiet)
            except (ConnectionError, OSError, RuntimeError, ValueError) as error:
                first = str(error).strip().splitlines()[0]
                raise ValueError(f"no Ray cluster answers at --address {address!r} ({first})") from error
            try:
                yield ray
            finally:
                ray.shutdown()
            return
        # Sockets lie below this folder, and their paths may have 107 characters at most.
        place = "/tmp" if os.path.isdir("/tmp") else None
        temporary = tempfile.mkdtemp(prefix="heave-", dir=place)
        inherited = dict.fromkeys(ONE_THREAD, "1") | {"PYTHONPATH": _python_path()}
        try:
            with _environment(inherited):
                ray.init(
                    address="local",
                    num_cpus=workers or _processors(),
                    num_gpus=0,
                    include_dashboard=False,
                    object_store_memory=_OBJECT_STORE,
                    _temp_dir=temporary,
                    **quiet,
                )
            yield ray
        finally:
            ray.shutdown()
            shutil.rmtree(temporary, ignore_errors=True)


def _check_address(address: str) -> None:
    """Refuses at once a port where nothing listens; Ray itself would try for minutes."""
    host, colon, port = address.rpartition(":")
    if "://" in address or not (colon and port.isdigit()):
        return
    try:
        socket.create_connection((host, int(port)), timeout=5.0).close()
    except (OSError, OverflowError) as error:
        raise ValueError(
            f"no Ray cluster answers at --address {address!r} ({error}); start one with ray start --head, or "
            "leave --address out to run on this machine"
        ) from error


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _python_path() -> str:
    """Where workers find this program, and all that this process finds."""
    root = str(Path(__file__).resolve().parents[1])
    return os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))


@contextlib.contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
