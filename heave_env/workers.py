"""Threads that share the calls of a compiled function, each on a core of its own.

The calls must let go of the interpreter. The caller takes its share too, and is kept on a core of its own for
as long: two threads that meet on one core wait for each other, while the scheduler takes milliseconds to
notice.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from typing import Any


class _Worker:
    """A thread that waits for a call, makes it and waits for the next."""

    def __init__(self, core: int | None) -> None:
        self.core = core
        self.call: tuple[Callable[..., Any], tuple[Any, ...]] | None = None
        self.error: BaseException | None = None
        self.is_given, self.is_done = threading.Lock(), threading.Lock()
        self.is_given.acquire()
        self.is_done.acquire()
        threading.Thread(target=self._work, daemon=True, name="heave_env").start()

    def _work(self) -> None:
        if self.core is not None:
            os.sched_setaffinity(0, {self.core})
        while True:
            self.is_given.acquire()
            if self.call is None:
                return
            function, arguments = self.call
            try:
                function(*arguments)
            except BaseException as error:
                self.error = error
            self.is_done.release()


class Workers:
    """So many threads, the caller's own among them."""

    def __init__(self, n_threads: int) -> None:
        """Starts the threads.

        Args:
            n_threads: Threads that share the calls. If the process may use as many cores, each keeps to one.
        """
        self.n_threads = n_threads
        cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
        self._cores: Sequence[int | None] = cores if len(cores) >= n_threads else [None] * n_threads
        self._workers = [_Worker(core) for core in self._cores[1:n_threads]]

    def __reduce__(self) -> tuple[Any, ...]:
        return Workers, (self.n_threads,)

    def __del__(self) -> None:
        self.close()

    def run(self, function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]) -> None:
        """Calls the function with each of the arguments, (n_threads,), side by side, and waits for all.

        Raises:
            BaseException: What one of the calls raised.
        """
        for worker, given in zip(self._workers, arguments[1:], strict=True):
            worker.call = function, given
            worker.is_given.release()
        core = self._cores[0]
        allowed = None if core is None else os.sched_getaffinity(0)
        try:
            if core is not None:
                os.sched_setaffinity(0, {core})
            function(*arguments[0])
        finally:
            for worker in self._workers:
                worker.is_done.acquire()
            if allowed is not None:
                os.sched_setaffinity(0, allowed)
        for worker in self._workers:
            error, worker.error = worker.error, None
            if error is not None:
                raise error

    def close(self) -> None:
        """Lets the threads end."""
        for worker in self._workers:
            worker.call = None
            worker.is_given.release()
        self._workers = []
