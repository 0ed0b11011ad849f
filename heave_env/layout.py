"""Rows of the state buffer, known to the compiled stages and to nobody outside the plant.

All real state of a batch lies in one buffer of shape (n_blocks, n_rows, n_lanes): environments are
the innermost axis, so that a row is one value of `heave_env.lanes`. The rows below stand first;
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
COMPENSATOR_DISPLACEMENT = 21
COMPENSATOR_RATE = 22
ENERGY_COST = 23

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
    "compensator_displacement",
    "compensator_rate",
    "energy_cost",
)
N_CHANNELS = len(CHANNEL_NAMES)

# Parameters of the row: plain numbers, or quantities that follow from them once and for all.
CABLE_STIFFNESS = 24
CABLE_DAMPING = 25
CABLE_INERTIA = 26
CABLE_WEIGHT = 27
CABLE_DRAG = 28
PAYLOAD_INERTIA = 29
PAYLOAD_WEIGHT = 30
PAYLOAD_DRAG = 31
BREAKING_STRENGTH = 32
INITIAL_LENGTH = 33
WINCH_RATE_CONSTANT = 34
WINCH_DECAY = 35
STROKE_LIMIT = 36
SPEED_LIMIT = 37
ACCELERATION_LIMIT = 38
COMMAND_RANGE = 39
POSITION_WEIGHT = 40
COMMAND_WEIGHT = 41
FAILURE_RATE = 42
TENSION_LIMIT = 43
LANDING_DEPTH = 44
DIVERGENCE_LIMIT = 45
# Linear payload over a solver step: two states to two states, then four numbers of the sheave's
# motion (heave and rate at either end) to two states.
LINEAR_TRANSITION = 46
LINEAR_INPUT = 50
PAY_OUT_SPEED = 58
PAY_OUT_START = 59
PAY_OUT_TIME = 60
PAY_OUT_RAMP = 61
# Second-order drive over a solver step: error and rate to error and rate.
WINCH_TRANSITION = 62
DEAD_BAND = 66
COMMAND_STEP = 67
POWER_LIMIT = 68
TORQUE_LIMIT = 69
DRUM_RADIUS = 70
DRUM_INERTIA = 71
SUPPLY_PER_WORK = 72
RETURNED_SHARE = 73
OWN_DELAY = 74
GAS_FORCE = 75
GAS_LENGTH = 76
GAS_EXPONENT = 77
COMPENSATOR_DAMPING = 78
COMPENSATOR_MASS = 79
HALF_STROKE = 80

# Of a rope beyond Hooke's law, whose stored energy over EA is e²/2 + QUADRATIC e³ + CUBIC e⁴.
CABLE_QUADRATIC = 81
CABLE_CUBIC = 82
RELAXING_STIFFNESS = 83
RELAXATION_RATE = 84
# The operation's pay-out rate, which is not a channel.
PAYOUT_RATE = 85
# Price of the winch's work whatever its sign, per metre moved (linear) or joule (cable).
ENERGY_WEIGHT = 86
N_FIXED = 87

# Fields of a node; the node j stands at the rows from `nodes + N_NODE_FIELDS * j`. Behind the last follow, of
# each element, the Maxwell branch (ropes beyond Hooke's law) and, if it is kept, the tension, mean over the
# last solver step.
DISPLACEMENT = 0
VELOCITY = 1
N_NODE_FIELDS = 2

# Rows of the scratch block, which a step fills before it reads them: one serves all blocks in turn, so that
# it stays in the cache.
OLD_BOOM_TIP = 0
OLD_BOOM_TIP_RATE = 1
NEW_BOOM_TIP = 2
NEW_BOOM_TIP_RATE = 3
SHEAVE_OLD = 4
SHEAVE_NEW = 5
SHEAVE_RATE_OLD = 6
SHEAVE_RATE_NEW = 7
WINCH_OLD = 8
WINCH_RATE_START = 9
LENGTH_OLD = 10
LENGTH_SPEED = 11
STEP_WORK = 12
STEP_SUPPLY = 13
ACTING_COMMAND = 14
BOOM_TIP_BELOW = 15
COMPENSATOR_OLD = 16
FIRST_TRIAL = 17
FIRST_GAP = 18
CONVECTION = 19
NODE_MASS = 20
NODE_DRAG = 21
NODE_WEIGHT = 22
PER_OLD_SPACING = 23
PER_MID_SPACING = 24
RELAXING_SHARE = 25
LINEAR_GAP = 26
WINCH_GAP = 27
STEP_MOVED = 28
SHOWN = 29  # four rows
N_SCRATCH = 33

# Fields of a node in the scratch block; what is called tension and stiffness belongs to the element below. A
# node's increment is SHARE times that of the next one towards the middle, plus LOADED.
SHARE = 0
LOADED = 1
INCREMENT = 2
TRIAL_VELOCITY = 3
ELEMENT_STIFFNESS = 4
ELEMENT_TENSION = 5
N_WORK_FIELDS = 6
