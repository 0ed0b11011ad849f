"""A mailbox in memory, through which compiled code of one thread gives calls to that of another.

Neither needs the interpreter, nor the operating system as long as both are awake. A call is one of a compiled
function of a share and an action, as the plant's kernel is, named by its address; whoever serves the mailbox
makes one after the other.
"""

from __future__ import annotations

from typing import Any

from numba import njit, types
from numba.core.cgutils import ir
from numba.extending import intrinsic

# Whole numbers of a mailbox, 8 bytes each. The caller writes those of the first two cache lines (two, since
# processors fetch them in pairs), the thread the others.
_GIVEN, _FUNCTION, _SHARE, _LEAVES = 0, 1, 2, 3
_DONE, _IS_AWAKE = 16, 17
N_MAILBOX = 32
"""Whole numbers of a mailbox."""


def _place(builder: Any, address: Any, number: Any) -> Any:
    offset = builder.mul(number, ir.Constant(ir.IntType(64), 8))
    return builder.inttoptr(builder.add(address, offset), ir.IntType(64).as_pointer())


@intrinsic
def _read(typing_context, mailbox, number):
    """A number of a mailbox, as the other thread last left it."""

    def generate(context, builder, called, values):
        return builder.load_atomic(_place(builder, *values), "seq_cst", 8)

    return types.int64(types.int64, types.int64), generate


@intrinsic
def _write(typing_context, mailbox, number, value):
    """Leaves a number in a mailbox; whoever reads it finds all that was written before it, too."""

    def generate(context, builder, called, values):
        builder.store_atomic(values[2], _place(builder, *values[:2]), "seq_cst", 8)
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, types.int64), generate


@intrinsic
def _call(typing_context, address, share):
    """Calls a compiled function of a share and an action, 0, that lies at an address."""

    def generate(context, builder, called, values):
        taken = (types.int64, types.float64)
        kind = context.call_conv.get_function_type(types.float64, taken)
        function = builder.inttoptr(values[0], kind.as_pointer())
        given = [values[1], ir.Constant(ir.DoubleType(), 0.0)]
        context.call_conv.call_function(builder, function, types.float64, taken, given)
        return context.get_dummy_value()

    return types.none(types.int64, types.int64), generate


@njit(cache=True, nogil=True)
def serve(mailbox, n_looks):
    """Makes the calls of a mailbox until so many looks have found none, or the thread is wanted elsewhere."""
    _write(mailbox, _IS_AWAKE, 1)
    done, looks = _read(mailbox, _DONE), 0
    while True:
        if _read(mailbox, _GIVEN) != done:
            _call(_read(mailbox, _FUNCTION), _read(mailbox, _SHARE))
            done, looks = done + 1, 0
            _write(mailbox, _DONE, done)
        elif looks < n_looks and _read(mailbox, _LEAVES) == 0:
            looks += 1
        else:
            _write(mailbox, _IS_AWAKE, 0)
            # A caller that came meanwhile may have taken the thread to be awake.
            if _read(mailbox, _GIVEN) == done:
                return
            _write(mailbox, _IS_AWAKE, 1)


@njit(cache=True)
def post(mailbox, function, share):
    """Puts a call into a mailbox; returns whether somebody is there to find it."""
    _write(mailbox, _FUNCTION, function)
    _write(mailbox, _SHARE, share)
    _write(mailbox, _GIVEN, _read(mailbox, _GIVEN) + 1)
    return _read(mailbox, _IS_AWAKE)


@njit(cache=True, nogil=True)
def wait_for(mailbox):
    """Waits until all calls of a mailbox have been made."""
    given = _read(mailbox, _GIVEN)
    while _read(mailbox, _DONE) != given:
        pass


@njit(cache=True)
def call_away(mailbox, leaves):
    """Calls a thread away from its mailbox, or allows it back."""
    _write(mailbox, _LEAVES, leaves)
