"""How compiled stages are declared, and the fingerprint that keeps their cache honest."""

from __future__ import annotations

import hashlib
import multiprocessing
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import event

# IEEE division and no reassociation: the same operations in the same order in every variant, so a row
# has the same bits alone and in a batch. Stages are inlined into the kernel that calls them.
stage = njit(error_model="numpy", forceinline=True, no_cfunc_wrapper=True)
# For a seldom effect: called, not inlined, so that kernels without it stay as short as they were.
seldom = njit(error_model="numpy", no_cfunc_wrapper=True)

_STAGE_FILES = (
    "streams.py",
    "layout.py",
    "lanes.py",
    "compiled.py",
    "hydrodynamics.py",
    "cable/constitutive.py",
    "cable/axial.py",
    "winch.py",
    "compensator.py",
    "kernel.py",
)


def entry_point(function: Any, *argument_types: Any) -> Any:
    """The compiled function itself, compiled now or found on disk if need be.

    Numba's own way to it looks the types of all arguments up in each call, which takes longer than a step of
    a short cable. This one trusts that they are what it is told here.
    """
    function.compile(argument_types)
    return function.overloads[argument_types].entry_point


def address_of(function: Any, *argument_types: Any) -> int:
    """Where the compiled function lies in memory, to be called from other compiled code."""
    function.compile(argument_types)
    made = function.overloads[argument_types]
    return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))


def source_fingerprint() -> int:
    """A number that changes whenever the source of any stage does.

    Numba's cache looks at the file of the cached function alone; kernels carry this number as a
    constant, so that an edit of an imported stage makes them compile anew.
    """
    digest = hashlib.sha256()
    for name in _STAGE_FILES:
        digest.update((Path(__file__).parent / name).read_bytes())
    return int.from_bytes(digest.digest()[:7], "big")


class _Notices(event.Listener):
    """Says on stderr what is being compiled; numba tells of it only when no cache had it."""

    def __init__(self) -> None:
        self.names: dict[int, str] = {}
        self._said: set[str] = set()

    def on_start(self, event: Any) -> None:
        name = self.names.get(id(event.data["dispatcher"]))
        # Workers of a vector environment would each say it.
        if name is None or multiprocessing.parent_process() is not None:
            return
        precision = getattr(event.data["args"][0], "dtype", None)
        said = name if precision is None else f"{name} in {precision}"
        if said not in self._said:
            self._said.add(said)
            print(f"heave_env: compiling {said}, this once; it is kept on disk", file=sys.stderr, flush=True)

    def on_end(self, event: Any) -> None:
        pass


_notices = _Notices()
event.register("numba:compile", _notices)


def announce_compilation(functions: Iterable[Any], name: str) -> None:
    """Lets a line on stderr say when one of the compiled functions has to be compiled: once for all of the
    same name together (in each precision, if the first argument is an array), and only if no cache has it.

    Args:
        functions: Functions compiled by numba, kept as long as the process lives.
        name: What they are, with about how long it takes.
    """
    _notices.names |= {id(function): name for function in functions}
