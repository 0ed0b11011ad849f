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
SUPPLY_POWER = 20

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
    "supply_power",
)
N_CHANNELS = len(CHANNEL_NAMES)

# Parameters of the row: plain numbers, or quantities that follow from them once and for all.
CABLE_STIFFNESS = 21
CABLE_DAMPING = 22
CABLE_INERTIA = 23
CABLE_WEIGHT = 24
CABLE_DRAG = 25
PAYLOAD_INERTIA = 26
PAYLOAD_WEIGHT = 27
PAYLOAD_DRAG = 28
BREAKING_STRENGTH = 29
INITIAL_LENGTH = 30
WINCH_RATE_CONSTANT = 31
WINCH_DECAY = 32
STROKE_LIMIT = 33
SPEED_LIMIT = 34
ACCELERATION_LIMIT = 35
COMMAND_RANGE = 36
POSITION_WEIGHT = 37
COMMAND_WEIGHT = 38
FAILURE_RATE = 39
TENSION_LIMIT = 40
LANDING_DEPTH = 41
DIVERGENCE_LIMIT = 42
# Linear payload over a solver step: two states to two states, then four numbers of the sheave's
# motion (heave and rate at either end) to two states.
LINEAR_TRANSITION = 43
LINEAR_INPUT = 47
PAY_OUT_SPEED = 55
PAY_OUT_START = 56
PAY_OUT_TIME = 57
PAY_OUT_RAMP = 58
# Second-order drive over a solver step: error and rate to error and rate.
WINCH_TRANSITION = 59
DEAD_BAND = 63
COMMAND_STEP = 64
POWER_LIMIT = 65
TORQUE_LIMIT = 66
DRUM_RADIUS = 67
DRUM_INERTIA = 68
SUPPLY_PER_WORK = 69
RETURNED_SHARE = 70
OWN_DELAY = 71

# Scratch of a step, rewritten by every step.
OLD_BOOM_TIP = 72
OLD_BOOM_TIP_RATE = 73
NEW_BOOM_TIP = 74
NEW_BOOM_TIP_RATE = 75
SHEAVE_OLD = 76
SHEAVE_NEW = 77
WINCH_OLD = 78
WINCH_RATE_START = 79
LENGTH_OLD = 80
MID_LENGTH = 81
LENGTH_SPEED = 82
STEP_WORK = 83
SHEAVE_RATE_OLD = 84
SHEAVE_RATE_NEW = 85
PAYOUT_RATE = 86
STEP_SUPPLY = 87
ACTING_COMMAND = 88
SCRATCH = 89
N_FIXED = 99

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
