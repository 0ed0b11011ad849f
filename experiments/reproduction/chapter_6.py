"""Huang (1992), chapter 6: identification, regulator, delay and stochastic control."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import expm
from scipy.signal import lsim

from baselines import design
from baselines.delay_lqr import taylor_matrices
from baselines.identification import PayloadFit, Response, first_guess, fit_payload
from baselines.lqr import continuous_gain
from baselines.model import continuous_model, regulator_matrices
from baselines.optimisation import IndexCurve, WinchCurve, index_curves, winch_curve
from experiments.figures import COLOURS
from experiments.reproduction.figure import Caption, reproduction
from experiments.rollout import rollout
from heave_env.parameters import LinearPayload, SeaState
from heave_env.plant import simulate
from heave_env.scenarios import load
from heave_env.sea import square_root
from heave_env.vessel import boom_tip_spectrum

Array = np.ndarray
DARK = "#30353d"
SEED = 20_000_000
"""The sea of every realisation here: the first test seed."""
DURATION = 200.0
"""Length of the realisations [s]."""
PRINTED = LinearPayload(inertia=7.339769, damping=0.1906759)
"""a and b of the text; the caption of figure 6.12 has b = 0.1996759."""
CAPTION_DAMPING = 0.1996759
PRINTED_NONLINEAR = (7.326944, 0.0719096)
PRINTED_GAIN = np.array([[93.944, 41.41, 5.166]])
PRINTED_DELAY_GAIN = np.array([[296.97, 132.73, 15.95, 2.306, 0.164]])
DELAY = 0.2
BOOM_TIP = "Pierson-Moskowitz, significant height 6 m, zero-crossing period 14 s"
CABLE = (
    "900 m of 47 mm cable, 9.09e9 N/m², 7.2 kg/m, 54 N/m in water, C_t 0.025; unit of 125 t effective mass, "
    "50 kN in water, 1 m², C_d 1"
)
OWN_SEA = "The thesis's random numbers are not printed: the realisation is ours"


# The regulator's cable and sea ---------------------------------------------------------------------


@cache
def _cable_run() -> dict[str, Array]:
    """Boom tip and payload of the 900 m cable with the winch locked, from rest; each (n_steps + 1,)."""
    channels = simulate(replace(load("thesis_cable"), start="hanging"), seeds=[SEED], duration=DURATION)
    return {name: values if name == "time" else values[:, 0] for name, values in channels.items()}


@cache
def _boom_tip() -> CubicHermiteSpline:
    run = _cable_run()
    return CubicHermiteSpline(run["time"], run["boom_tip_heave"], run["boom_tip_heave_rate"])


@cache
def _fit(nonlinear: bool) -> PayloadFit:
    run = _cable_run()
    response = Response(
        float(run["time"][1]),
        *(
            run[name][:, None]
            for name in ("boom_tip_heave", "boom_tip_heave_rate", "payload_heave", "payload_heave_rate")
        ),
    )
    inertia, damping = first_guess(load("thesis_cable"))
    return fit_payload(response, inertia=inertia, damping=damping, nonlinear=nonlinear)


def _reconstructed(a: float, b: float, *, nonlinear: bool) -> Array:
    """Payload heave of the second-order model under the same boom tip at the run's instants [m]."""
    run, x0 = _cable_run(), _boom_tip()

    def slope(t: float, x: Array) -> list[float]:
        damping = b * x[1] * (abs(x[1]) if nonlinear else 1.0)
        return [x[1], (float(x0(t)) - x[0] - damping) / a]

    start = (run["payload_heave"][0], run["payload_heave_rate"][0])
    time = run["time"]
    solution = solve_ivp(slope, (0.0, time[-1]), start, t_eval=time, rtol=1e-6, atol=1e-6, max_step=0.5)
    return np.asarray(solution.y[0])


def _over_time(axes: Any, quantity: str, last: float = DURATION) -> None:
    axes.set_xlabel("time [s]")
    axes.set_ylabel(quantity)
    axes.set_xlim(0.0, last)


def _legend(axes: Any, room: float = 0.3) -> None:
    """A legend in a row along the upper edge, with room made for it."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + room * (high - low))
    axes.legend(loc="upper left", ncols=3, borderaxespad=0.1)


def _std(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


@reproduction("H 6.10", "Boom-tip motion of the identification")
def thesis_6_10(figure: Any) -> Caption:
    run = _cable_run()
    axes = figure.subplots()
    axes.plot(run["time"], run["boom_tip_heave"], color=COLOURS[3])
    _over_time(axes, "boom-tip heave [m]")
    return Caption(
        parameters=f"{BOOM_TIP}; sum of 128 sinusoids of random phase and frequency within its bin.",
        shows=f"Standard deviation of this realisation {_std(run['boom_tip_heave']):.2f} m; of the sea 1.5 "
        "m.",
        assumed=f"{OWN_SEA}.",
    )


@reproduction("H 6.11", "Response of the subsea unit on the 900 m cable")
def thesis_6_11(figure: Any) -> Caption:
    run = _cable_run()
    axes = figure.subplots()
    axes.plot(run["time"], run["boom_tip_heave"], color=COLOURS[0], lw=0.9, label="boom tip")
    axes.plot(run["time"], run["payload_heave"], color=COLOURS[1], label="subsea unit")
    _over_time(axes, "heave [m]")
    _legend(axes, 0.15)
    gain = _std(run["payload_heave"]) / _std(run["boom_tip_heave"])
    return Caption(
        parameters=f"{CABLE}. {BOOM_TIP}; 20 elements, step 0.05 s, winch locked, from rest.",
        shows=f"The unit moves {gain:.1f} times as much as the boom tip, for the cable resonates at 0.371 "
        "rad/s, within the sea's band.",
        assumed=f"{OWN_SEA}. The cable carries compression, as in the thesis.",
    )


def _draw_reconstruction(figure: Any, model: Array, label: str, own: Array) -> tuple[float, float]:
    run = _cable_run()
    above, below = figure.subplots(2, sharex=True, height_ratios=(2, 1))
    above.plot(run["time"], run["payload_heave"], color=COLOURS[0], lw=2.4, label="cable")
    above.plot(run["time"], model, color=COLOURS[1], lw=1.1, label=label)
    above.set_ylabel("unit's heave [m]")
    _legend(above)
    misfits = model - run["payload_heave"], own - run["payload_heave"]
    below.plot(run["time"], misfits[0], color=COLOURS[1], lw=1.1, label="printed, less cable")
    below.plot(run["time"], misfits[1], color=COLOURS[3], lw=1.1, label="fitted here, less cable")
    _legend(below, 0.45)
    _over_time(below, "misfit [m]")
    figure.align_ylabels()
    return _std(misfits[0]), _std(misfits[1])


@reproduction("H 6.12", "Reconstruction with the linear second-order model", size=(6.0, 4.6))
def thesis_6_12(figure: Any) -> Caption:
    fit = _fit(False)
    printed = _reconstructed(PRINTED.inertia, CAPTION_DAMPING, nonlinear=False)
    own = _reconstructed(fit.inertia, fit.damping, nonlinear=False)
    misfits = _draw_reconstruction(figure, printed, "7.340 x'' + 0.200 x' + x = x0", own)
    return Caption(
        parameters=f"a = 7.339769 s², b = {CAPTION_DAMPING} s as in the caption (the text has 0.1906759), on "
        f"the boom tip of 6.10; fitted to this realisation a = {fit.inertia:.4f} s², b = {fit.damping:.4f} "
        "s.",
        shows=f"Root mean square misfit {misfits[0]:.2f} m printed, {misfits[1]:.2f} m fitted, of "
        f"{_std(_cable_run()['payload_heave']):.2f} m. The printed a is 1 % above ours, as the "
        "thesis's damped scheme would make it at steps of 0.27 s. What the fit leaves is quadratic drag.",
        assumed=f"{OWN_SEA}.",
    )


@reproduction("H 6.13", "Reconstruction with the nonlinear second-order model", size=(6.0, 4.6))
def thesis_6_13(figure: Any) -> Caption:
    fit = _fit(True)
    printed = _reconstructed(*PRINTED_NONLINEAR, nonlinear=True)
    own = _reconstructed(fit.inertia, fit.damping, nonlinear=True)
    misfits = _draw_reconstruction(figure, printed, "7.327 x'' + 0.0719 |x'| x' + x = x0", own)
    return Caption(
        parameters="a = 7.326944 s², b = 0.0719096 s²/m as printed, on the boom tip of 6.10; fitted to this "
        f"realisation a = {fit.inertia:.4f} s², b = {fit.damping:.4f} s²/m.",
        shows=f"Root mean square misfit {misfits[0]:.2f} m printed, {misfits[1]:.3f} m fitted: the quadratic "
        "damping is the right one, as the thesis says. Its b follows from the drag, (payload + a quarter of "
        "the cable's)/k = 0.0536 s²/m; the printed one cannot be had from the printed data.",
        assumed=f"{OWN_SEA}.",
    )


# The regulator -------------------------------------------------------------------------------------


@cache
def _regulated(dt: float = 0.01) -> tuple[Array, Array]:
    """Time and states x, x', u of the printed model under the printed gain, from rest, exactly."""
    A, B, C = regulator_matrices(PRINTED, 1.0)
    time = dt * np.arange(round(DURATION / dt) + 1)
    closed = (A - B @ PRINTED_GAIN, C, np.eye(3), np.zeros((3, 1)))
    _, states, _ = lsim(closed, _boom_tip()(time), time)
    return time, np.asarray(states)


@cache
def _unregulated() -> Array:
    """Payload of the printed model with the winch locked, at the run's instants, from rest [m]."""
    A, _, C = regulator_matrices(PRINTED, 1.0)
    time = _cable_run()["time"]
    fine = 0.01 * np.arange(round(DURATION / 0.01) + 1)
    _, states, _ = lsim((A[:2, :2], C[:2], np.eye(2), np.zeros((2, 1))), _boom_tip()(fine), fine)
    return np.asarray(np.interp(time, fine, states[:, 0]))


@cache
def _cable_regulated() -> dict[str, Array]:
    """Payload and winch of the 900 m cable itself under the tuned regulator [m], from its still place."""
    scenario = load("thesis_cable")
    trajectory = rollout(scenario, design("lqr", scenario), [SEED], duration=DURATION)
    return {name: trajectory.states[name][:, 0] for name in ("payload_heave", "winch_displacement")}


OF_THE_PRINTED = (
    "Printed gain G = [93.944, 41.41, 5.166] on the printed model a = 7.339769 s², b = 0.1906759 s, K = 1 "
    "per second, continuous and noise-free, from rest"
)
GAIN_NOTE = (
    "The printed gain is not that of the printed a and b: within 1.2 % it is the one for a = 2.28 s², b = "
    "2.43 s, Q = diag(1e4, 0, 0), R = 1. The sign is u0 = -G x"
)


@reproduction("H 6.14", "Boom-tip motion of the regulator's run")
def thesis_6_14(figure: Any) -> Caption:
    run = _cable_run()
    axes = figure.subplots()
    axes.plot(run["time"], run["boom_tip_heave"], color=COLOURS[3])
    _over_time(axes, "boom-tip heave [m]")
    return Caption(
        parameters=f"{BOOM_TIP}: the realisation of 6.10.",
        shows="What the winch has to oppose in 6.15 and 6.16.",
        assumed=f"{OWN_SEA}, and that the run is that of the identification.",
    )


@reproduction("H 6.15", "Subsea unit with and without the regulator", size=(6.0, 4.6))
def thesis_6_15(figure: Any) -> Caption:
    time, states = _regulated()
    run, cable = _cable_run(), _cable_regulated()["payload_heave"]
    above, below = figure.subplots(2, sharex=True)
    above.plot(run["time"], _unregulated(), color=COLOURS[0], label="without control")
    above.plot(time, states[:, 0], color=COLOURS[1], label="regulator, printed gain")
    above.set_ylabel("unit's heave [m]")
    _legend(above)
    below.plot(time, states[:, 0], color=COLOURS[1], label="printed gain and model")
    below.plot(run["time"], cable, color=COLOURS[3], lw=1.0, label="our regulator on the cable")
    _over_time(below, "unit's heave [m]")
    _legend(below)
    figure.align_ylabels()
    return Caption(
        parameters=f"{OF_THE_PRINTED}. Below, enlarged, with the regulator of this project at 0.1 s on the "
        "cable of 6.11, tuned on other seas.",
        shows=f"Root mean square {_std(_unregulated()):.2f} m without control, {_std(states[:, 0]):.3f} m "
        f"with it, {_std(cable):.3f} m on the cable. {GAIN_NOTE}.",
        assumed=f"{OWN_SEA}. Which of the two unlabelled figures, 6.15 and 6.16, shows the unit.",
    )


@reproduction("H 6.16", "Output of the winch and the boom tip that it opposes")
def thesis_6_16(figure: Any) -> Caption:
    time, states = _regulated()
    run, winch = _cable_run(), _cable_regulated()["winch_displacement"]
    axes = figure.subplots()
    axes.plot(run["time"], run["boom_tip_heave"], color=COLOURS[0], label="boom tip")
    axes.plot(time, states[:, 2], color=COLOURS[1], label="winch, printed")
    axes.plot(run["time"], winch, color=COLOURS[3], lw=0.7, label="winch, on the cable")
    _over_time(axes, "displacement [m]")
    _legend(axes, 0.12)
    left = _std(states[:, 2] + _boom_tip()(time)) / _std(run["boom_tip_heave"])
    return Caption(
        parameters=f"{OF_THE_PRINTED}.",
        shows="The winch moves against the boom tip, as the thesis says: what is left at the sheave has "
        f"{left:.1%} of the boom tip's root mean square. On the cable "
        "the loop rings at 3.9 rad/s beside it, for no second-order model knows the cable's waves.",
        assumed=f"{OWN_SEA}. Which of the two unlabelled figures, 6.15 and 6.16, shows the winch.",
    )


@cache
def _regulated_with_delay(dt: float = 0.01) -> tuple[Array, Array]:
    """Time and states of the printed model under the printed five-state gain; the delay itself is exact.

    The controller integrates its two states of (6.13) from its own commands.
    """
    A, B, C = regulator_matrices(PRINTED, 1.0)
    A5, B5 = taylor_matrices(PRINTED, 1.0, DELAY)
    plant, delay = _held(A, np.hstack([B, C]), dt), _held(A5[3:, 3:], B5[3:], dt)
    n_steps, n_late = round(DURATION / dt), round(DELAY / dt)
    time = dt * np.arange(n_steps + 1)
    # The boom tip over a step by its middle.
    x0 = _boom_tip()(time[:-1] + 0.5 * dt)
    states, commands = np.zeros((n_steps + 1, 3)), np.zeros(n_steps + n_late)
    model = np.zeros(2)
    for k in range(n_steps):
        command = -(PRINTED_DELAY_GAIN[0, :3] @ states[k] + PRINTED_DELAY_GAIN[0, 3:] @ model)
        commands[k + n_late] = command
        states[k + 1] = plant[0] @ states[k] + plant[1] @ np.array([commands[k], x0[k]])
        model = delay[0] @ model + delay[1][:, 0] * command
    return time, states


def _held(A: Array, B: Array, dt: float) -> tuple[Array, Array]:
    """Transition over a step with the inputs held."""
    n, m = B.shape
    block = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * dt)
    return block[:n, :n], block[:n, n:]


@reproduction("H 6.17", "Subsea unit under the regulator that knows of a delay of 0.2 s", size=(6.0, 4.6))
def thesis_6_17(figure: Any) -> Caption:
    time, states = _regulated_with_delay()
    scenario = load("thesis_regulator_delay")
    trajectory = rollout(scenario, design("delay_lqr", scenario), [SEED], duration=DURATION)
    ours = trajectory.states["payload_heave"][:, 0]
    above, below = figure.subplots(2, sharex=True)
    above.plot(_cable_run()["time"], _unregulated(), color=COLOURS[0], label="without control")
    above.plot(time, states[:, 0], color=COLOURS[1], label="with control, printed gain")
    above.set_ylabel("unit's heave [m]")
    _legend(above)
    below.plot(time, states[:, 0], color=COLOURS[1], label="printed gain, continuous")
    below.plot(trajectory.time, ours, color=COLOURS[3], lw=1.0, label="ours, every 0.1 s")
    _over_time(below, "unit's heave [m]")
    _legend(below)
    figure.align_ylabels()
    index, index_without = float(np.linalg.norm(PRINTED_DELAY_GAIN)), float(np.linalg.norm(PRINTED_GAIN))
    return Caption(
        parameters="Printed gain G = [296.97, 132.73, 15.95, 2.306, 0.164] on the printed model a = "
        "7.339769 s², b = 0.1906759 s, K = 1 per second, with a pure delay of 0.2 s, from rest, at 0.01 s. "
        "Below, enlarged, with the delay regulator of this project, q = 1e5, on the same model.",
        shows=f"Root mean square {_std(_unregulated()):.2f} m without control, {_std(states[:, 0]):.3f} m "
        f"with the printed gain, {_std(ours):.3f} m with ours. The controlled response stays small, and the "
        f"norm of the gain rises from {index_without:.0f} to {index:.0f}.",
        assumed=f"{OWN_SEA}. The gain is, within 1.2 %, that of Q = diag(1e5, 0, ...) for a = 2.28 s², b = "
        "2.43 s.",
    )


@cache
def _indices() -> tuple[IndexCurve, IndexCurve]:
    return index_curves(load("thesis_regulator"), np.logspace(1.0, 6.0, 16), delay=DELAY)


def _draw_indices(figure: Any, of: Callable[[IndexCurve], Array], label: str) -> Caption:
    axes = figure.subplots()
    curves = _indices()
    for curve, colour, marker, name in zip(
        curves, (COLOURS[3], COLOURS[1]), ("o", "s"), ("no delay", "delay 0.2 s"), strict=True
    ):
        stable = np.isfinite(of(curve))
        axes.loglog(
            curve.energy[stable], of(curve)[stable], color=colour, marker=marker, markersize=3.5, label=name
        )
    axes.set_xlabel("control energy index J_c = Σ G² [-]")
    axes.set_ylabel(label)
    axes.legend()
    plain, late = curves
    wanted = float(of(plain)[np.searchsorted(plain.energy, 1e3)])
    stable = np.isfinite(of(late))
    needed = [
        float(
            np.exp(np.interp(math.log(wanted), np.log(of(curve)[ok][::-1]), np.log(curve.energy[ok][::-1])))
        )
        for curve, ok in ((plain, np.isfinite(of(plain))), (late, stable))
    ]
    return Caption(
        parameters=f"Printed model a = 7.339769 s², b = 0.1906759 s, K = 1 per second; {BOOM_TIP}; "
        "regulators for R = 1 and q from 10 to 1e6, of (6.6) without delay and of the Taylor model (6.14) "
        "with 0.2 s, run at 0.1 s with the exact delay. Indices over 100 s, expected values in the steady "
        "state.",
        shows=f"For the effect of {wanted:.3g} the delay takes {needed[1] / needed[0]:.1f} times the energy "
        "index: more energy for the same effect, as the thesis says. Where the sampled loop is unstable no "
        "point is drawn.",
        assumed="The weights that were varied and the time of the indices; the shaping filter stands for "
        "the sea.",
    )


@reproduction("H 6.18", "Displacement index against control energy index")
def thesis_6_18(figure: Any) -> Caption:
    return _draw_indices(figure, lambda curve: curve.displacement, "displacement index J_d = ∫ x² dt [m² s]")


@reproduction("H 6.19", "Velocity index against control energy index")
def thesis_6_19(figure: Any) -> Caption:
    return _draw_indices(figure, lambda curve: curve.velocity, "velocity index J_v = ∫ x'² dt [m²/s]")


# Stochastic control --------------------------------------------------------------------------------


def _box(axes: Any, x: float, y: float, text: str, colour: str, width: float = 1.9) -> None:
    from matplotlib.patches import FancyBboxPatch

    axes.add_patch(
        FancyBboxPatch(
            (x - 0.5 * width, y - 0.32),
            width,
            0.64,
            boxstyle="round,pad=0.02,rounding_size=0.08",
            facecolor="white",
            edgecolor=colour,
            linewidth=1.3,
        )
    )
    axes.text(x, y, text, ha="center", va="center", fontsize=8)


def _arrow(
    axes: Any, *corners: tuple[float, float], label: str = "", at: tuple[float, float] = (0, 0)
) -> None:
    for start, end in pairwise(corners[:-1]):
        axes.plot([start[0], end[0]], [start[1], end[1]], color=DARK, lw=1.1, solid_capstyle="butt")
    axes.annotate(
        "",
        xy=corners[-1],
        xytext=corners[-2],
        arrowprops={"arrowstyle": "-|>", "color": DARK, "lw": 1.1, "shrinkA": 0, "shrinkB": 0},
    )
    if label:
        axes.text(*at, label, ha="center", va="center", fontsize=8, color=DARK)


@reproduction("H 6.20", "Design and structure of the stochastic control system", size=(7.0, 3.6))
def thesis_6_20(figure: Any) -> Caption:
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set_xlim(-0.3, 10.6)
    axes.set_ylim(-0.6, 4.2)
    sea, system, law, offline = COLOURS[3], COLOURS[4], COLOURS[1], COLOURS[0]
    _box(axes, 1.6, 3.6, "wave filter\n(6.23), 6 states", sea)
    _box(axes, 4.6, 3.6, "vessel\n(6.26), 2 states", sea)
    _box(axes, 8.0, 3.6, "cable and subsea unit\n(6.27), 2 states", system, 2.4)
    _box(axes, 8.0, 1.9, "sensors\non the subsea unit", system, 2.4)
    _box(axes, 4.6, 1.9, "Kalman filter\n11 states", law)
    _box(axes, 1.6, 1.9, "gain\nu0 = -G x, (6.30)", law)
    _box(axes, 1.6, 0.2, "Riccati equation\nweights Q, R", offline)
    _box(axes, 4.6, 0.2, "model (6.28):\nsea, vessel, cable, winch", offline, 2.3)
    _box(axes, 4.6, 2.75, "winch (6.5), 1 state", system)
    _arrow(axes, (-0.2, 3.6), (0.63, 3.6), label="w", at=(0.15, 3.78))
    _arrow(axes, (2.57, 3.6), (3.63, 3.6), label="η", at=(3.1, 3.78))
    _arrow(axes, (5.57, 3.6), (6.78, 3.6), label="x0", at=(6.15, 3.78))
    _arrow(axes, (8.0, 3.26), (8.0, 2.24), label="x, x'", at=(8.32, 2.75))
    _arrow(axes, (6.78, 1.9), (5.57, 1.9), label="y", at=(6.15, 2.08))
    _arrow(axes, (3.63, 1.9), (2.57, 1.9), label="estimate", at=(3.1, 2.08))
    _arrow(axes, (1.6, 2.24), (1.6, 2.75), (3.63, 2.75), label="u0", at=(2.6, 2.93))
    _arrow(axes, (5.57, 2.75), (6.15, 2.75), (6.15, 3.45), (6.78, 3.45), label="u", at=(5.85, 2.93))
    _arrow(axes, (1.6, 0.54), (1.6, 1.56), label="G", at=(1.8, 1.05))
    _arrow(axes, (3.43, 0.2), (2.57, 0.2))
    _arrow(axes, (4.6, 0.54), (4.6, 1.56))
    axes.text(10.5, 1.05, "designed beforehand below,\nrunning above", ha="right", fontsize=8, color=DARK)
    return Caption(
        parameters="w white noise of intensity π, η elevation, x0 boom tip, u winch output, u0 command, x "
        "and x' heave of the subsea unit and its rate, y what is measured of them; equation numbers are the "
        "thesis's.",
        shows="Blue: sea and vessel, formulated into the state; green: plant; red: control law; grey: "
        "design.",
        assumed="The arrangement: of the thesis's diagram only its purpose is told in the text.",
    )


@reproduction("H 6.21", "Bretschneider spectrum and its rational approximation")
def thesis_6_21(figure: Any) -> Caption:
    sea = load("thesis_linear").sea_state
    omega = np.linspace(0.02, 3.0, 800)
    true = boom_tip_spectrum(omega, _random_phase(sea), None)
    rational = boom_tip_spectrum(omega, sea, None)
    axes = figure.subplots()
    axes.plot(omega, true, color=COLOURS[3], label="Bretschneider, (6.20) with ω_m⁴/ω⁵")
    axes.plot(omega, rational, color=COLOURS[1], ls="--", label="rational, (6.21)")
    axes.axvline(sea.peak_omega, color=DARK, lw=0.8, ls=":")
    axes.annotate("ω_m", (sea.peak_omega, 0.02), textcoords="offset points", xytext=(3, 0), fontsize=8)
    axes.set_xlabel("frequency [rad/s]")
    axes.set_ylabel("spectral density [m² s]")
    axes.set_xlim(0.0, 3.0)
    axes.set_ylim(bottom=0.0)
    axes.legend()
    wide = np.linspace(1e-3, 40.0, 200_000)
    std = math.sqrt(float(np.trapezoid(boom_tip_spectrum(wide, sea, None), wide)))
    share = std**2 / sea.variance
    return Caption(
        parameters="H_1/3 = 3.048 m, ω_m = 0.785 rad/s, ω0 = 0.9538 ω_m.",
        shows=f"The filter's elevation has {std:.4f} m of standard deviation, {share:.0%} of the variance of "
        f"the true {0.25 * sea.significant_wave_height:.3f} m, with a peak that is lower and broader: "
        "further improvement is needed here, as the thesis says.",
        assumed="Nothing. In print the powers of (6.20) are interchanged.",
    )


def _random_phase(sea: SeaState) -> SeaState:
    return replace(sea, kind="random_phase")


@cache
def _stochastic() -> dict[str, Array]:
    """Elevation, boom tip, and payload without and with control of H 6.3.6 under the same noise.

    Sea and vessel begin stationary, the subsea unit at rest; the transitions are exact, and of the noise
    within a step only what reaches sea and vessel, for it is integrated twice more on its way to the unit.
    """
    dt, n_steps = 0.05, 6000
    model = continuous_model(load("thesis_linear"))
    gain = continuous_gain(model.A, model.B1, 554.0, 1.0)
    n = len(model.A)
    sea_A, sea_noise = model.A[3:, 3:], model.noise[3:, 3:]
    # Van Loan: covariance of the noise over a step.
    m = n - 3
    block = expm(np.block([[-sea_A, sea_noise], [np.zeros((m, m)), sea_A.T]]) * dt)
    step_root = square_root(block[m:, m:].T @ block[:m, m:])
    noise = np.random.default_rng(SEED).standard_normal((n_steps + 1, m))
    start = np.concatenate([np.zeros(3), square_root(model.covariance()[3:, 3:]) @ noise[0]])
    result: dict[str, Array] = {"time": dt * np.arange(n_steps + 1)}
    for name, closed in (("free", model.A), ("controlled", model.A - model.B1 @ gain)):
        F = expm(closed * dt)
        states = np.empty((n_steps + 1, n))
        states[0] = start
        for k in range(n_steps):
            states[k + 1] = F @ states[k]
            states[k + 1, 3:] += step_root @ noise[k + 1]
        result[name] = states[:, 0]
    # The vessel's second state is fed by the elevation, the payload's by the boom tip over a.
    result["elevation"] = model.thesis_sizes[4] * states[:, 5:] @ model.A[4, 5:]
    result["boom_tip"] = states[:, 3:] @ model.A[1, 3:] / -model.A[1, 0]
    result["std"] = np.sqrt(np.array([model.covariance()[0, 0], model.covariance(gain)[0, 0]]))
    return result


STOCHASTIC = (
    "H_1/3 = 3.048 m, ω_m = 0.785 rad/s; ω_v = 0.393 rad/s, ξ_v = 0.6, K_v = 0.5; a = 0.8959 s², b = 0.1658 s"
)


@reproduction("H 6.22", "A realisation of the wave elevation")
def thesis_6_22(figure: Any) -> Caption:
    run = _stochastic()
    axes = figure.subplots()
    axes.plot(run["time"], run["elevation"], color=COLOURS[3])
    _over_time(axes, "elevation [m]")
    return Caption(
        parameters="Filter (6.22) with H_1/3 = 3.048 m, ω_m = 0.785 rad/s, driven by white noise of "
        "intensity π.",
        shows=f"Standard deviation over 300 s {float(np.std(run['elevation'])):.3f} m; of the filter 0.738 "
        "m.",
        assumed=f"{OWN_SEA}, begun stationary.",
    )


@reproduction("H 6.23", "Uncontrolled response of the subsea unit, σ = 0.255 m")
def thesis_6_23(figure: Any) -> Caption:
    run = _stochastic()
    axes = figure.subplots()
    axes.plot(run["time"], run["boom_tip"], color=COLOURS[0], lw=1.0, label="boom tip")
    axes.plot(run["time"], run["free"], color=COLOURS[1], label="subsea unit")
    for sign in (-1.0, 1.0):
        axes.axhline(
            sign * 0.255, color=DARK, lw=0.8, ls=":", label="± 0.255 m, printed" if sign > 0 else None
        )
    _over_time(axes, "heave [m]")
    figure.legend(loc="outside upper center", ncols=3)
    return Caption(
        parameters=f"{STOCHASTIC}.",
        shows=f"Standard deviation by (6.31) {run['std'][0]:.4f} m, printed 0.255 m; of this realisation "
        f"over 300 s {float(np.std(run['free'])):.3f} m. (6.35) as printed, over both signs of frequency, "
        "gives 0.361 m.",
        assumed=f"{OWN_SEA}; the unit at rest at the start.",
    )


@reproduction("H 6.24", "Controlled response of the subsea unit, σ = 2.96e-4 m", size=(6.0, 4.6))
def thesis_6_24(figure: Any) -> Caption:
    run = _stochastic()
    scenario = load("thesis_linear")
    lqg = rollout(scenario, design("lqg", scenario), [SEED], duration=300.0)
    settled = run["time"] >= 20.0
    above, below = figure.subplots(2, sharex=True)
    above.plot(run["time"][settled], 1e3 * run["controlled"][settled], color=COLOURS[1], label="state known")
    for sign in (-1.0, 1.0):
        above.axhline(
            sign * 0.296, color=DARK, lw=0.8, ls=":", label="± 0.296 mm, printed" if sign > 0 else None
        )
    above.set_ylabel("heave [mm]")
    above.set_ylim(-1.3, 1.3)
    above.legend(loc="upper left", ncols=2)
    noisy = 1e3 * lqg.states["payload_heave"][:, 0]
    below.plot(
        lqg.time, noisy, color=COLOURS[3], lw=1.0, label="Kalman filter on noisy sensors, another realisation"
    )
    below.legend(loc="upper left")
    _over_time(below, "heave [mm]", 200.0)
    below.set_xlim(20.0, 200.0)
    late = lqg.time >= 20.0
    shown = np.abs(noisy[late]).max()
    below.set_ylim(-1.5 * shown, 1.5 * shown)
    figure.align_ylabels()
    return Caption(
        parameters=f"{STOCHASTIC}; K = 1 per second, Q = diag(q, 0, ...) with q = 554, R = 1. Below, the "
        "same with heave and heave rate of the unit measured with white noise of spectral density 1e-6, "
        "command every 0.1 s.",
        shows=f"Standard deviation by (6.31) {run['std'][1]:.3e} m, printed 2.96e-4 m; energy index 23.0. Of "
        f"these realisations from 20 s on {float(np.std(run['controlled'][settled])):.2e} m and, with noise, "
        f"{1e-3 * float(np.std(noisy[late])):.2e} m: the printed figure needs all eleven states without "
        "noise.",
        assumed=f"{OWN_SEA}. The weights are not printed: q is the one that gives the printed figure.",
    )


@cache
def _winches() -> WinchCurve:
    rates = np.concatenate([np.logspace(-1.0, 0.0, 11), np.logspace(0.0, math.log10(50.0), 13)[1:]])
    return winch_curve(load("thesis_linear"), 2.96e-4, rates)


@reproduction("H 6.25", "Optimisation of the winch parameter K")
def thesis_6_25(figure: Any) -> Caption:
    curve = _winches()
    axes = figure.subplots()
    axes.loglog(curve.rate_constant, curve.energy_index, color=COLOURS[1])
    at_one = float(curve.energy_index[np.isclose(curve.rate_constant, 1.0)][0])
    axes.plot(1.0, at_one, "o", color=COLOURS[3], markersize=5, label=f"K = 1 of the example: {at_one:.1f}")
    least = float(curve.energy_index.min())
    axes.axhline(least, color=DARK, lw=0.8, ls=":", label=f"least: {least:.1f}")
    enough = float(curve.rate_constant[np.nonzero(curve.energy_index < 1.05 * least)[0][0]])
    axes.set_xlabel("winch parameter K [1/s]")
    axes.set_ylabel("energy index sqrt(Σ G²) [-]")
    axes.set_yticks([20.0, 30.0, 50.0, 100.0], ["20", "30", "50", "100"])
    axes.set_xticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])
    axes.minorticks_off()
    axes.legend()
    return Caption(
        parameters=f"{STOCHASTIC}; for each K from 0.1 to 50 per second the weight q that leaves the unit "
        "2.96e-4 m of standard deviation, full state known.",
        shows=f"Beyond K of about {enough:.1f} per second less than 5 % is left to gain; a slow winch costs "
        "steeply: there is a critical K, as the thesis says.",
        assumed="That the prescribed deviation is that of 6.24.",
    )
