"""The compiled loop over many control steps, around the kernel's one: `rollouts` is its face.

A block of environments makes all its steps before the next block begins, so that its state stays in the
processor's cache. A policy's parameters lie beside the environments, one lane for each.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from heave_env.compiled import announce_compilation, source_fingerprint, stage
from heave_env.kernel import DIVERGED, KERNELS, RUNNING, SHARE_FIRST_BLOCK, SHARE_LAST_BLOCK, SHARE_POSITION
from heave_env.layout import (
    COMMAND_COST,
    ENERGY_COST,
    FAILURE_COST,
    PAYLOAD_HEAVE,
    POSITION_COST,
    SAFETY_COST,
    TENSION_MAX,
    TENSION_MIN,
)

# Rows of the totals of a batch.
(
    TOTAL_COST,
    TOTAL_POSITION,
    TOTAL_COMMAND,
    TOTAL_ENERGY,
    TOTAL_FAILURE,
    TOTAL_SAFETY,
    LOWEST,
    HIGHEST,
    FARTHEST,
    STEPS_MADE,
    FATE,
    N_TOTALS,
) = range(12)

_SUMS = (
    (TOTAL_POSITION, POSITION_COST),
    (TOTAL_COMMAND, COMMAND_COST),
    (TOTAL_ENERGY, ENERGY_COST),
    (TOTAL_FAILURE, FAILURE_COST),
    (TOTAL_SAFETY, SAFETY_COST),
)
"""Which cost of a step goes into which total."""

# A compiled function finds those it calls among the globals, by name.
_first, _second, _third, _fourth = ([advance for advance, _ in KERNELS.values()] * 4)[:4]


@stage
def bounded_tanh(x):
    """tanh x in float32, to 3e-7 of itself: Lambert's continued fraction at x/2, then the double angle."""
    real = np.float32
    half = real(0.5) * min(max(x, real(-9.5)), real(9.5))
    s = half * half
    above = half * (real(135135.0) + s * (real(17325.0) + s * (real(378.0) + s)))
    below = real(135135.0) + s * (real(62370.0) + s * (real(3150.0) + real(28.0) * s))
    t = above / below
    return real(2.0) * t / (real(1.0) + t * t)


@stage
def _act(parameters, widths, x, y, actions, first_row, n_rows, n_lanes):
    """Actions of a block's rows: layer by layer, each output's bias first and then its weights.

    `x`, (widest, n_lanes), holds the observations; both it and `y` are overwritten.
    """
    at = 0
    n_layers = len(widths) - 1
    for layer in range(n_layers):
        for out in range(widths[layer + 1]):
            into, bias = y[out], parameters[at]
            for lane in range(n_lanes):
                into[lane] = bias[lane]
            at += 1
            for i in range(widths[layer]):
                weight, value = parameters[at], x[i]
                for lane in range(n_lanes):
                    into[lane] += weight[lane] * value[lane]
                at += 1
        if layer < n_layers - 1:
            # All outputs lie one behind the other: one long loop over them.
            outputs = y[: widths[layer + 1]].ravel()
            for i in range(len(outputs)):
                outputs[i] = bounded_tanh(outputs[i])
        x, y = y, x
    for lane in range(n_rows):
        actions[first_row + lane] = x[0, lane]


@stage
def _add_up(state, n_rows, reward, outcome, counts, cable, taken, totals):
    """Adds a step to the totals of a block's rows, (N_TOTALS, n_lanes); returns how many rows still run.

    What is left out of a total adds nothing to it, so that the loops ask no question and the compiler makes
    vectors of them. `taken`, (2, n_lanes), says whose costs count and whose extremes.
    """
    running = 0
    costs, extremes = taken
    for lane in range(n_rows):
        runs, fate = totals[FATE, lane] == RUNNING, outcome[lane]
        costs[lane] = runs & (counts | (state[FAILURE_COST, lane] > 0.0))
        extremes[lane] = runs & counts & (fate != DIVERGED)
        totals[STEPS_MADE, lane] += runs
        totals[FATE, lane] = fate if runs else totals[FATE, lane]
        running += runs & (fate == RUNNING)
    for lane in range(n_rows):
        totals[TOTAL_COST, lane] -= reward[lane] if costs[lane] else 0.0
    for total, cost in _SUMS:
        for lane in range(n_rows):
            totals[total, lane] += state[cost, lane] if costs[lane] else 0.0
    for lane in range(n_rows):
        heave = abs(state[PAYLOAD_HEAVE, lane]) if extremes[lane] else 0.0
        totals[FARTHEST, lane] = max(totals[FARTHEST, lane], heave)
    if cable:
        for lane in range(n_rows):
            tension = state[TENSION_MIN, lane] if extremes[lane] else np.inf
            totals[LOWEST, lane] = min(totals[LOWEST, lane], tension)
        for lane in range(n_rows):
            tension = state[TENSION_MAX, lane] if extremes[lane] else -np.inf
            totals[HIGHEST, lane] = max(totals[HIGHEST, lane], tension)
    return running


def _make(which: int, fingerprint: int):
    """The loop over steps around one of the kernels, in the order of `KERNELS`."""

    @njit(cache=True, nogil=True, error_model="numpy")
    def march(
        state, observation, actions, reward, outcome, share, n_steps, n_settling, given, widths,
        parameters, cable, columns, record, totals,
    ):  # fmt: skip
        """Advances the rows of the blocks by many control steps.

        Args:
            state: The plant's state, (n_blocks, n_rows, n_lanes).
            observation: What the kernel fills, (n_envs, n_observed).
            actions: What the kernel reads, as long as all blocks together.
            reward: What the kernel fills, (n_envs,).
            outcome: What the kernel fills, (n_envs,).
            share: What the kernel is told of: configuration, scratch block, first block and last, and the
                control steps made, which are counted on, (5,).
            n_steps: Control steps to make.
            n_settling: How many of them count for nothing but a failure.
            given: Fractions of the command range, (n_steps, n_envs); no rows under a policy.
            widths: Widths of the policy's layers, observation first.
            parameters: Of the policy, (n_blocks or 1, n_parameters, n_lanes), float32.
            cable: Whether there are tensions.
            columns: Channels to record.
            record: Filled from its second instant on, (n_columns, n_steps + 1, n_envs).
            totals: Filled, (N_TOTALS, n_envs).
        """
        if fingerprint == 0:
            return
        n_envs, n_observed = observation.shape
        n_lanes = state.shape[2]
        acts = len(given) == 0
        own_share = share.copy()
        widest = max(widths)
        x, y = np.zeros((widest, n_lanes), np.float32), np.zeros((widest, n_lanes), np.float32)
        own, taken = np.zeros((N_TOTALS, n_lanes)), np.zeros((2, n_lanes), np.bool_)
        for block in range(share[SHARE_FIRST_BLOCK], share[SHARE_LAST_BLOCK]):
            own_share[SHARE_FIRST_BLOCK], own_share[SHARE_LAST_BLOCK] = block, block + 1
            own_share[SHARE_POSITION] = share[SHARE_POSITION]
            first_row = block * n_lanes
            n_rows = min(n_lanes, n_envs - first_row)
            own[:] = 0.0
            own[LOWEST], own[HIGHEST] = np.inf, -np.inf
            for step in range(n_steps):
                if acts:
                    for lane in range(n_rows):
                        for i in range(n_observed):
                            x[i, lane] = observation[first_row + lane, i]
                    # One set of parameters is everybody's.
                    mine = min(block, len(parameters) - 1)
                    _act(parameters[mine], widths, x, y, actions, first_row, n_rows, n_lanes)
                else:
                    for lane in range(n_rows):
                        actions[first_row + lane] = given[step, first_row + lane]
                # Only one of these is compiled.
                if which == 0:
                    _first(own_share.ctypes.data, actions[first_row])
                elif which == 1:
                    _second(own_share.ctypes.data, actions[first_row])
                elif which == 2:
                    _third(own_share.ctypes.data, actions[first_row])
                else:
                    _fourth(own_share.ctypes.data, actions[first_row])
                for c in range(len(columns)):
                    for lane in range(n_rows):
                        record[c, step + 1, first_row + lane] = state[block, columns[c], lane]
                counts = step >= n_settling
                given_back, became = reward[first_row:], outcome[first_row:]
                running = _add_up(state[block], n_rows, given_back, became, counts, cable, taken, own)
                if running == 0 and len(columns) == 0:
                    break
            for total in range(N_TOTALS):
                for lane in range(n_rows):
                    totals[total, first_row + lane] = own[total, lane]
        # The kernel reads its share by the address alone: the memory must live until here.
        own_share[SHARE_FIRST_BLOCK] = 0
        share[SHARE_POSITION] += n_steps

    return march


LOOPS = {key: _make(which, source_fingerprint()) for which, key in enumerate(KERNELS)}
"""The loop around each of `KERNELS`, by its key there."""
for (_, _n_lanes), _loop in LOOPS.items():
    _of = "one environment" if _n_lanes == 1 else "a batch"
    announce_compilation((_loop,), f"the loop over many steps of {_of} (about 15 s)")
