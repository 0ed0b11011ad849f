"""Arrays that are handed out, and used again once nobody holds them any more.

A batch of thousands returns as many new observations in every step. To ask the system for that memory each
time, and to give it back, takes as long as a good part of the step, and with several threads more, since
every core must be told.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

_MOST_KEPT = 4
"""Arrays that a pool remembers: the plant holds one, its caller often the last two."""


def _holders_of_the_kept() -> int:
    """What `sys.getrefcount` says in `Pool.take` of an array that the pool alone holds."""
    for array, _ in [(np.empty(1), 0)]:
        return sys.getrefcount(array)
    raise AssertionError


_ALONE = _holders_of_the_kept()


class Pool:
    """Arrays of one shape and type."""

    def __init__(self, shape: tuple[int, ...], dtype: Any) -> None:
        """Begins without any."""
        self._shape, self._dtype = shape, dtype
        self._kept: list[tuple[np.ndarray, int]] = []

    def take(self) -> tuple[np.ndarray, int]:
        """An array of whatever numbers, which nobody else holds, nor a view of it, and its address."""
        for array, address in self._kept:
            if sys.getrefcount(array) == _ALONE:
                return array, address
        # With memory of its own: a view of another's would not be held by views of it.
        array = np.empty(self._shape, self._dtype)
        if len(self._kept) == _MOST_KEPT:
            self._kept.pop(0)
        self._kept.append((array, array.ctypes.data))
        return self._kept[-1]
