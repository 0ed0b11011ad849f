"""Threads that share the calls of a compiled function, each on a core of its own.

Putting a thread to sleep and waking it takes longer than a step of a thousand cables. So a thread that has
made its share of a step looks for the next one for a while, inside compiled code and without the
interpreter, before it goes to sleep; the caller, whose own share is as long, waits for the others in the
same way. Two threads that meet on one core would wait for each other while the scheduler takes
milliseconds to notice: each keeps to a core of its own, the caller for as long as the call.
"""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from numba import types

from heave_env.compiled import entry_point
from heave_env.lanes import aligned_zeros
from heave_env.mailbox import N_MAILBOX, call_away, post, serve, wait_for

AWAKE_FOR = 3e-4
"""How long a thread looks for its next call before it goes to sleep [s]."""

_ANSWERS_MAILBOX = object()
"""What a thread is told that is to look into its mailbox."""


class _Worker:
    """A thread that makes the calls of its mailbox, or sleeps until there is one, or something else."""

    def __init__(self, core: int | None) -> None:
        self._core = core
        # Found now: numba looks for nothing any more when the interpreter is about to end.
        self._call_away = entry_point(call_away, types.int64, types.int64)
        self._memory = aligned_zeros((N_MAILBOX,), "int64")
        self.mailbox = int(self._memory.ctypes.data)
        self._told: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._is_done = threading.Semaphore(0)
        self._error: BaseException | None = None
        threading.Thread(target=self._work, daemon=True, name="heave_env").start()

    def _work(self) -> None:
        if self._core is not None:
            os.sched_setaffinity(0, {self._core})
        n_looks = 0
        while (told := self._told.get()) is not None:
            if told is _ANSWERS_MAILBOX:
                n_looks = n_looks or _looks_until_sleep()
                serve(self.mailbox, n_looks)
                continue
            function, arguments = told
            self._call_away(self.mailbox, 0)
            try:
                function(*arguments)
            except BaseException as error:
                self._error = error
            self._is_done.release()

    def wake(self) -> None:
        """Has the thread look into its mailbox."""
        self._told.put(_ANSWERS_MAILBOX)

    def tell(self, told: tuple[Callable[..., Any], tuple[Any, ...]] | None) -> None:
        """Has the thread call a function of Python, or end."""
        self._call_away(self.mailbox, 1)
        self._told.put(told)

    def answer(self) -> BaseException | None:
        """Waits for the function of Python to return; what it raised, if anything."""
        self._is_done.acquire()
        error, self._error = self._error, None
        return error


def _looks_until_sleep() -> int:
    """Looks into a mailbox that take about `AWAKE_FOR`."""
    mailbox, n_looks = aligned_zeros((N_MAILBOX,), "int64"), 20_000
    address = int(mailbox.ctypes.data)
    serve(address, 1)
    begin = time.perf_counter()
    serve(address, n_looks)
    return max(1, int(n_looks * AWAKE_FOR / (time.perf_counter() - begin)))


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
        self._post = entry_point(post, *[types.int64] * 3)
        self._wait_for = entry_point(wait_for, types.int64)

    def __reduce__(self) -> tuple[Any, ...]:
        return Workers, (self.n_threads,)

    def __del__(self) -> None:
        self.close()

    def run(self, function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]) -> None:
        """Calls the function with each of the arguments, (n_threads,), side by side, and waits for all.

        The function should let go of the interpreter while it works.

        Raises:
            BaseException: What one of the calls raised.
        """
        for worker, given in zip(self._workers, arguments[1:], strict=True):
            worker.tell((function, given))
        allowed = self._keep_to_own_core()
        try:
            function(*arguments[0])
        finally:
            errors = [worker.answer() for worker in self._workers]
            self._give_core_back(allowed)
        for error in errors:
            if error is not None:
                raise error

    def run_compiled(
        self, function: Callable[[int, float], Any], address: int, shares: Sequence[int]
    ) -> None:
        """Calls a compiled function side by side with each of the shares, and waits for all.

        Args:
            function: Takes a share and an action, here 0, as the plant's kernel does; raises nothing.
            address: Where the same function lies, as `compiled.address_of` gives it.
            shares: One for each thread, (n_threads,).
        """
        if self._cores[0] is None:
            # They would wait for each other on the cores that there are.
            self.run(function, [(share, 0.0) for share in shares])
            return
        for worker, share in zip(self._workers, shares[1:], strict=True):
            if not self._post(worker.mailbox, address, share):
                worker.wake()
        allowed = self._keep_to_own_core()
        try:
            function(shares[0], 0.0)
        finally:
            for worker in self._workers:
                self._wait_for(worker.mailbox)
            self._give_core_back(allowed)

    def _keep_to_own_core(self) -> set[int] | None:
        core = self._cores[0]
        if core is None:
            return None
        allowed = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {core})
        return allowed

    def _give_core_back(self, allowed: set[int] | None) -> None:
        if allowed is not None:
            os.sched_setaffinity(0, allowed)

    def close(self) -> None:
        """Lets the threads end."""
        for worker in self._workers:
            worker.tell(None)
        self._workers = []
