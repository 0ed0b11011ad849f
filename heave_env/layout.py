"""Rows of the state buffer, known to the compiled stages and to nobody outside the plant.

All real state of a batch lies in one buffer of shape (n_blocks, n_rows, n_lanes): environments are
the innermost axis, so that every loop over lanes is a vector operation. The rows below stand first;
behind them follow, at offsets kept in the integer configuration, the wave filter, the sinusoids, the
command ring, the sensor ring and the cable's nodes.
"""

from __future__ import annotations

# What the plant shows to sensors, infos and recordings; `CHANNEL_NAMES` names them in this order.
PAYLOAD_HEAVE = 0
PAYLOAD_HEAVE_RATE = 1
BOOM_TIP_HEAVE = 2
BOOM_TIP_HEAVE_RATE = 3
WINCH_DISPLACEMENT = 4
WINCH_RATE = 5
SHEAVE_TENSION = 6
LENGTH = 7
PAYLOAD_TENSION = 8
PAYOUT = 9
COMMAND = 10
POSITION_COST = 11
COMMAND_COST = 12
FAILURE_COST = 13
SAFETY_COST = 14
SATURATED = 15
SLACK = 16
TENSION_MIN = 17
TENSION_MAX = 18
WINCH_POWER = 19

CHANNEL_NAMES = (
    "payload_heave",
    "payload_heave_rate",
    "boom_tip_heave",
    "boom_tip_heave_rate",
    "winch_displacement",
    "winch_rate",
    "sheave_tension",
    "length",
    "payload_tension",
    "payout",
    "command",
    "position_cost",
    "command_cost",
    "failure_cost",
    "cost",
    "saturated",
    "slack",
    "tension_min",
    "tension_max",
    "winch_power",
)
N_CHANNELS = len(CHANNEL_NAMES)

# Parameters of the row: plain numbers, or quantities that follow from them once and for all.
CABLE_STIFFNESS = 20
CABLE_DAMPING = 21
CABLE_INERTIA = 22
CABLE_WEIGHT = 23
CABLE_DRAG = 24
PAYLOAD_INERTIA = 25
PAYLOAD_WEIGHT = 26
PAYLOAD_DRAG = 27
BREAKING_STRENGTH = 28
INITIAL_LENGTH = 29
WINCH_RATE_CONSTANT = 30
WINCH_DECAY = 31
STROKE_LIMIT = 32
SPEED_LIMIT = 33
ACCELERATION_LIMIT = 34
COMMAND_RANGE = 35
POSITION_WEIGHT = 36
COMMAND_WEIGHT = 37
FAILURE_RATE = 38
TENSION_LIMIT = 39
LANDING_DEPTH = 40
DIVERGENCE_LIMIT = 41
# Linear payload over a solver step: two states to two states, then four numbers of the sheave's
# motion (heave and rate at either end) to two states.
LINEAR_TRANSITION = 42
LINEAR_INPUT = 46
PAY_OUT_SPEED = 54
PAY_OUT_START = 55
PAY_OUT_TIME = 56
PAY_OUT_RAMP = 57

# Scratch of a step, rewritten by every step.
OLD_BOOM_TIP = 58
OLD_BOOM_TIP_RATE = 59
NEW_BOOM_TIP = 60
NEW_BOOM_TIP_RATE = 61
SHEAVE_OLD = 62
SHEAVE_NEW = 63
WINCH_OLD = 64
WINCH_RATE_START = 65
LENGTH_OLD = 66
MID_LENGTH = 67
LENGTH_SPEED = 68
STEP_WORK = 69
SHEAVE_RATE_OLD = 70
SHEAVE_RATE_NEW = 71
PAYOUT_RATE = 72
SCRATCH = 73
N_FIXED = 83

# Fields of a node; the node j stands at the rows from `nodes + N_NODE_FIELDS * j`.
DISPLACEMENT = 0
VELOCITY = 1
INCREMENT = 2
TRIAL_VELOCITY = 3
SUPER = 4
LOAD = 5
ELEMENT_STIFFNESS = 6
ELEMENT_TENSION = 7
N_NODE_FIELDS = 8
