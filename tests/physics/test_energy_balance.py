"""The plant's energy: sheave and winch do what drag and damping take and motion, strain and height store."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from heave_env import kernel, layout
from heave_env.cable import constitutive
from heave_env.plant import Plant
from heave_env.scenarios import Scenario, load


@dataclasses.dataclass
class Balance:
    """Energies of one episode [J]; what enters is positive."""

    by_sheave: float = 0.0
    by_winch: float = 0.0
    by_drag: float = 0.0
    by_damping: float = 0.0
    carried_in: float = 0.0
    stored: float = 0.0

    @property
    def left_over(self) -> float:
        entered = self.by_sheave + self.by_winch + self.carried_in
        return entered - self.by_drag - self.by_damping - self.stored


def audit(scenario: Scenario, seed: int, duration: float) -> Balance:
    """The balance of one row over an episode under a command that leans against the boom tip.

    Positive is down inside. Cable that runs off the drum carries its kinetic and elastic energy and its
    height with it; the drum holds it at the strain at the sheave, so that the sheave's tension moves
    1 + strain as much of it as the winch pays out unstretched.
    """
    # One solver step per control step, so that each step's tension and motion can be seen from outside.
    scenario = dataclasses.replace(scenario, control_dt=scenario.solver_dt, n_substeps=1, duration=duration)
    assert scenario.cable is not None and scenario.payload is not None
    cable, payload, n, dt = scenario.cable, scenario.payload, scenario.n_elements, scenario.control_dt
    plant = Plant(scenario, 1)
    plant.begin(np.ones(1, dtype=bool), np.array([seed]))
    first = int(plant._cfg[kernel.ROW_NODES])
    share = np.ones(n + 1)
    share[[0, -1]] = 0.5  # half a cell at either end
    above = 1.0 - np.arange(n + 1) / n  # share of the length that hangs below a node

    def nodes() -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
        rows = plant._state[0, first : first + layout.N_NODE_FIELDS * (n + 1), 0]
        held = plant._state[0, first + layout.N_NODE_FIELDS * (n + 1) :, 0][:n]
        rows = rows.reshape(n + 1, layout.N_NODE_FIELDS)
        length = float(plant.channel("length")[0])
        return rows[:, layout.DISPLACEMENT].copy(), rows[:, layout.VELOCITY].copy(), length, held.copy()

    def stored(displacement, velocity, length, held) -> float:
        mass = cable.inertia_per_length * length / n * share
        weight = cable.submerged_weight * length / n * share
        mass[-1] += payload.inertia
        weight[-1] += payload.submerged_weight
        strain = np.diff(displacement) * n / length
        elastic = np.sum(constitutive.stored_energy(cable, strain)) * length / n
        if not cable.is_hookean:
            elastic += 0.5 * cable.relaxing_stiffness * np.sum(held**2) * length / n
        position = length * (1.0 - above) + displacement
        return float(0.5 * np.sum(mass * velocity**2) + elastic - np.sum(weight * position))

    def with_top(state):
        # The sheave's node has no equation of motion: its velocity is the boom tip's and the cable's.
        displacement, velocity, length, held = state
        velocity = velocity.copy()
        velocity[0] = 2.0 * velocity[1] - velocity[2]
        return displacement, velocity, length, held

    balance, before = Balance(), with_top(nodes())
    begun = stored(*before)
    for _ in range(scenario.n_steps):
        boom_tip = float(plant.channel("boom_tip_heave")[0] + plant.channel("winch_displacement")[0])
        plant.advance(np.array([-0.5 * boom_tip / scenario.winch.command_range]))
        now = with_top(nodes())
        (U0, W0, L0, a0), (U1, W1, L1, a1) = before, now
        T, V = float(plant.channel("sheave_tension")[0]), (L1 - L0) / dt
        L, W = 0.5 * (L0 + L1), 0.5 * (W0 + W1)
        e0, e1 = np.diff(U0) * n / L0, np.diff(U1) * n / L1
        if cable.tension_only:
            e0, e1 = np.maximum(e0, 0.0), np.maximum(e1, 0.0)
        strain = 0.5 * float(1.5 * (e0[0] + e1[0]) - 0.5 * (e0[1] + e1[1]))  # at the sheave
        drag = cable.tangential_drag_per_length * L / n * share
        drag[-1] += payload.drag_factor
        by_sheave, by_winch = -T * (U1[0] - U0[0]), -T * V * dt
        by_drag = float(np.sum(drag * np.abs(W) ** 3)) * dt
        by_damping = cable.axial_damping * float(np.sum((e1 - e0) ** 2)) / dt * L / n
        if not cable.is_hookean:
            middle = 0.5 * (a0 + a1)
            by_damping += cable.relaxing_stiffness / cable.relaxation_time * np.sum(middle**2) * L / n * dt
        carried = 0.5 * cable.inertia_per_length * W[0] ** 2 + float(
            constitutive.stored_energy(cable, strain)
        )
        carried -= cable.submerged_weight * 0.5 * (U0[0] + U1[0])
        balance.by_sheave += float(by_sheave)
        balance.by_winch += by_winch
        balance.by_drag += by_drag
        balance.by_damping += float(by_damping)
        balance.carried_in += float(carried - T * strain) * V * dt
        before = now
    balance.stored = stored(*before) - begun
    return balance


ROPE = {
    "axial_stiffness": 4e6,
    "quadratic_hardening": 10.0,
    "cubic_hardening": 100.0,
    "relaxing_stiffness": 2e6,
    "relaxation_time": 10.0,
}


@pytest.mark.parametrize(
    "name, rope",
    [
        ("thesis_cable", {}),
        ("sea_state_5", {}),
        ("deep_resonance", {}),
        ("lowering", {}),
        ("lowering", ROPE),
        ("landing", {}),
    ],
)
def test_work_of_sheave_and_winch_is_drag_damping_and_stored_energy(name, rope):
    scenario = load(name)
    scenario = dataclasses.replace(
        scenario, cable=dataclasses.replace(scenario.cable, **rope), n_iterations=10
    )
    balance = audit(scenario, 1, 200.0)
    lost = balance.by_drag + balance.by_damping
    label = f"{name} on a soft rope" if rope else name
    print(f"{label}: {balance}; left over {100 * balance.left_over / lost:.3f} % of what was lost")
    # Measured against the least of the parts, which the works of sheave and winch exceed many times over.
    assert abs(balance.left_over) < 5e-3 * lost


def test_without_drag_and_damping_nothing_is_lost():
    scenario = load("lowering")
    cable = dataclasses.replace(scenario.cable, tangential_drag_coefficient=0.0, axial_damping=0.0)
    payload = dataclasses.replace(scenario.payload, drag_area=0.0)
    dragless = dataclasses.replace(scenario, cable=cable, payload=payload, n_iterations=10)
    balance = audit(dragless, 1, 100.0)
    assert balance.by_drag == balance.by_damping == 0.0
    print(f"without drag: left over {100 * balance.left_over / abs(balance.stored):.4f} % of what was stored")
    assert abs(balance.left_over) < 1e-4 * abs(balance.stored)
