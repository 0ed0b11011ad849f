"""The thesis's own scheme for the axial cable: for comparison alone, no solver of this project.

With c(y) = (o - y) L'/L, o = 0 in print, o = 1 for the material (y = 0 sheave, 1 payload; positive down):

    D/Dt  = ∂/∂T + c ∂/∂y,    W = DU/Dt + L'
    D²/Dt² = ∂²/∂T² + 2 c ∂²/∂y∂T + c² ∂²/∂y² + (o - y)(L''/L - 2 L'²/L²) ∂/∂y
    cable    (m + m_a)(D²U/Dt² + L'') + (π/2) ρ d C_t |W| W = (EA/L²) ∂²U/∂y² + w1
    payload  (M_s + M_a)(D²U/Dt² + L'') + (1/2) ρ S C_d |W| W = w2 - (EA/L) ∂U/∂y

Print takes time derivatives at a fixed place beneath the sheave (o = 0), although new cable enters there; in
the material form the payload has no convective term. For a massless cable the printed equations turn U into
U · L/L0, exactly: that is the growth that the thesis's lowering carries.

Scheme: Houbolt's backward differences (2, -5, 4, -1)/Δt² and (3, -4, 1)/2Δt, central differences in y,
one-sided ones of second order at the payload, as in (3.8)-(3.10). Second order in time and space,
unconditionally stable, with an algorithmic damping ratio of (ωΔt)³/2 and a period elongation of
(11/24)(ωΔt)². Drag is linearised about the last iterate.

Source: Huang (1992), (3.1)-(3.10); Houbolt (1950).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from heave_env.parameters import Cable, Payload

Array = np.ndarray


@njit(cache=True, error_model="numpy")
def _march(  # type: ignore[no-untyped-def]
    numbers, offset, dt, n_iterations, sheave, length, speed, acceleration, history, out
):
    """Marches the four levels `history` (4, n + 1), oldest first, through the motion; fills `out`."""
    EA, mass, w1, drag, M, w2, payload_drag = numbers
    n = history.shape[1] - 1
    h = 1.0 / n
    of_load, of_next = np.zeros(n + 1), np.zeros(n + 1)
    U = history[3].copy()
    for k in range(len(sheave)):
        if k > 0:
            history[:3] = history[1:].copy()
            a, b, c = history[2], history[1], history[0]  # one, two and three steps ago
            L, v, v_dot = length[k], speed[k], acceleration[k]
            U[0] = sheave[k]
            for _ in range(n_iterations):
                of_load[0], of_next[0] = U[0], 0.0
                for i in range(1, n):
                    g = offset - i * h
                    conv = g * v / L
                    rate = (3.0 * U[i] - 4.0 * a[i] + b[i]) / (2.0 * dt)
                    W = rate + conv * (U[i + 1] - U[i - 1]) / (2.0 * h) + v
                    F = drag * abs(W)
                    A = mass * conv * conv - EA / (L * L)
                    C = 2.0 * mass * conv
                    D = mass * g * (v_dot / L - 2.0 * v * v / (L * L)) + F * conv
                    upper = A / (h * h) + 3.0 * C / (4.0 * h * dt) + D / (2.0 * h)
                    lower = A / (h * h) - 3.0 * C / (4.0 * h * dt) - D / (2.0 * h)
                    diagonal = -2.0 * A / (h * h) + 2.0 * mass / (dt * dt) + 1.5 * F / dt
                    load = (
                        w1
                        - mass * v_dot
                        - F * v
                        + mass * (5.0 * a[i] - 4.0 * b[i] + c[i]) / (dt * dt)
                        + F * (4.0 * a[i] - b[i]) / (2.0 * dt)
                        - C * (b[i + 1] - b[i - 1] - 4.0 * (a[i + 1] - a[i - 1])) / (4.0 * h * dt)
                    )
                    pivot = 1.0 / (diagonal - lower * of_next[i - 1])
                    of_next[i] = upper * pivot
                    of_load[i] = (load - lower * of_load[i - 1]) * pivot
                # U_i = of_load_i - of_next_i U_{i+1}; the payload's row reaches three nodes up.
                conv = (offset - 1.0) * v / L
                slope = (3.0 * U[n] - 4.0 * U[n - 1] + U[n - 2]) / (2.0 * h)
                W = (3.0 * U[n] - 4.0 * a[n] + b[n]) / (2.0 * dt) + conv * slope + v
                F = payload_drag * abs(W)
                A = M * conv * conv
                C = 2.0 * M * conv
                D = M * (offset - 1.0) * (v_dot / L - 2.0 * v * v / (L * L)) + EA / L + F * conv
                first, second = D / (2.0 * h) + 3.0 * C / (4.0 * h * dt), A / (h * h)
                row = (
                    3.0 * first + 2.0 * second + 2.0 * M / (dt * dt) + 1.5 * F / dt,
                    -4.0 * first - 5.0 * second,
                    first + 4.0 * second,
                    -second,
                )
                old_slope = (3.0 * b[n] - 4.0 * b[n - 1] + b[n - 2]) - 4.0 * (
                    3.0 * a[n] - 4.0 * a[n - 1] + a[n - 2]
                )
                load = (
                    w2
                    - M * v_dot
                    - F * v
                    + M * (5.0 * a[n] - 4.0 * b[n] + c[n]) / (dt * dt)
                    + F * (4.0 * a[n] - b[n]) / (2.0 * dt)
                    - C * old_slope / (4.0 * h * dt)
                )
                constant, factor, total = 0.0, 1.0, row[0]
                for up in range(1, 4):
                    i = n - up
                    constant = of_load[i] - of_next[i] * constant
                    factor = -of_next[i] * factor
                    load -= row[up] * constant
                    total += row[up] * factor
                U[n] = load / total
                for i in range(n - 1, 0, -1):
                    U[i] = of_load[i] - of_next[i] * U[i + 1]
            history[3] = U
        out[k] = U[n]


@dataclass(frozen=True, kw_only=True)
class ThesisScheme:
    """Houbolt's scheme for the axial cable, in print's form or the material's."""

    cable: Cable
    payload: Payload
    printed: bool
    """Whether to leave the convective term out, as print does."""
    n_elements: int = 20
    n_iterations: int = 2

    def __post_init__(self) -> None:
        if self.n_elements < 4:
            raise ValueError(
                f"n_elements must be at least 4, for the payload's row reaches three nodes up, got "
                f"{self.n_elements}"
            )

    def simulate(self, sheave_heave: Array, dt: float, length: Array, *, deflection: float = 0.0) -> Array:
        """Payload above its static position at the length of the same instant [m], (n_steps + 1,).

        The three levels before the start are taken equal to it: the cable hangs still in the moving frame, as
        the thesis has it, with the lower end pulled down by `deflection` beyond its static stretch [m].

        Args:
            sheave_heave: Heave of the sheave, positive up [m], (n_steps + 1,).
            dt: Time step [s].
            length: Unstretched length [m], (n_steps + 1,); its rates are taken by differences.
            deflection: Initial deflection of the payload, linear along the cable, positive down [m].
        """
        heave, lengths = np.asarray(sheave_heave, dtype=float), np.asarray(length, dtype=float)
        cable, payload = self.cable, self.payload
        y = np.linspace(0.0, 1.0, self.n_elements + 1)
        EA, w1, w2 = cable.axial_stiffness, cable.submerged_weight, payload.submerged_weight
        L = lengths[0]
        static = L / EA * (w2 * y + w1 * L * (y - 0.5 * y**2))
        history = np.tile(-heave[0] + static + deflection * y, (4, 1))
        out = np.empty(len(heave))
        speed = np.gradient(lengths, dt)
        numbers = (
            EA,
            cable.inertia_per_length,
            w1,
            cable.tangential_drag_per_length,
            payload.inertia,
            w2,
            payload.drag_factor,
        )
        _march(
            numbers,
            0.0 if self.printed else 1.0,
            dt,
            self.n_iterations,
            -heave,
            lengths,
            speed,
            np.gradient(speed, dt),
            history,
            out,
        )
        return lengths * (w2 + 0.5 * w1 * lengths) / EA - out


def houbolt_root(omega_dt: float) -> complex:
    """The scheme's amplification factor of an undamped oscillator per step, of the pair that is physical.

    2 z³ - 5 z² + 4 z - 1 + (ωΔt)² z³ = 0; |z| < 1 is the algorithmic damping.
    """
    roots = np.roots([2.0 + omega_dt**2, -5.0, 4.0, -1.0])
    upper = roots[roots.imag > 1e-12]
    return complex(upper[np.argmin(abs(upper - np.exp(1j * omega_dt)))])
