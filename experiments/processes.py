"""Work shared out over processes of this machine, one thread each.

Everything goes by pickle between a process and those that it has started itself; no file is one.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import TypeVar

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Variables that keep a process to one thread: read when its libraries are loaded."""

Job = TypeVar("Job")
Result = TypeVar("Result")


def worker_count(asked: int | None) -> int:
    """Processes to work in: as many as asked for, or else one for each processor that we may use."""
    if asked is not None:
        return asked
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on this system
        return os.cpu_count() or 1


def shared_out(
    work: Callable[[Job], Result], jobs: Sequence[Job], workers: int
) -> Iterator[tuple[Job, Result]]:
    """Does jobs side by side and gives each with its result as it is done.

    The processes end with the loop over them, however it ends.

    Args:
        work: A function of a module, which takes a job.
        jobs: What is to be done, begun in this order.
        workers: Processes; with one, all is done in this one.

    Raises:
        Exception: What `work` raises; what has not begun by then is not done.
    """
    if workers <= 1 or len(jobs) <= 1:
        for job in jobs:
            yield job, work(job)
        return
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(
        min(workers, len(jobs)), multiprocessing.get_context("spawn"), initializer=_leave_to_the_parent
    )
    try:
        with _single_threaded():  # they are started by the first submissions
            waiting = {pool.submit(work, job): job for job in jobs}
        for future in as_completed(waiting):
            yield waiting[future], future.result()
        pool.shutdown()
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        pool.shutdown(cancel_futures=True)  # waits for its thread, which alone reaps them
        raise


def _leave_to_the_parent() -> None:
    """Ctrl-C reaches every process of the terminal: the parent ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextlib.contextmanager
def _single_threaded() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
