"""The plant's energy: boom tip and winch do what is lost to drag and damping or stored, slack or taut."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from heave_env import kernel, layout
from heave_env.cable import constitutive
from heave_env.parameters import Cable
from heave_env.plant import Plant
from heave_env.scenarios import Scenario, load, with_values


@dataclasses.dataclass
class Balance:
    """Energies of one episode [J]; what enters is positive."""

    by_boom_tip: float = 0.0
    by_winch: float = 0.0
    by_drag: float = 0.0
    by_damping: float = 0.0
    by_rod: float = 0.0
    carried_in: float = 0.0
    stored: float = 0.0
    slack: float = 0.0
    """Share of the steps in which the cable is slack somewhere [-]."""
    out_of_line: float = 0.0
    """Winch and supply power shown, less those of tension, speed, efficiency and regeneration [J]."""

    @property
    def left_over(self) -> float:
        entered = self.by_boom_tip + self.by_winch + self.carried_in - self.by_rod
        return entered - self.by_drag - self.by_damping - self.stored


def damped(cable: Cable, old: np.ndarray, new: np.ndarray, dt: float) -> float:
    """What Kelvin damping takes in a step, per unstretched length of an element [J/m].

    It acts on the taut part of the strain, over the whole way. Where spring and damper would push a
    tension-only cable it is pulled by nothing, and all that the spring gives back is lost.
    """
    x, y = (np.maximum(e, 0.0) if cable.tension_only else e for e in (old, new))
    lost = cable.axial_damping * (y - x) * (new - old) / dt
    gained = constitutive.stored_energy(cable, new) - constitutive.stored_energy(cable, old)
    pushed = cable.tension_only & ((gained + lost) * np.sign(new - old) < 0.0)
    return float(np.sum(np.where(pushed, -gained, lost)))


def audit(scenario: Scenario, seed: int, duration: float) -> Balance:
    """The balance of one row over an episode under a command that leans against the boom tip.

    Positive is down inside. Cable that runs off the drum carries its kinetic and elastic energy and its
    height with it; the drum holds it at the strain at the sheave, so that the sheave's tension moves
    1 + strain as much of it as the winch pays out unstretched. Between boom tip and sheave stands the rod of
    a compensator without moving mass: its damper takes energy, its gas stores it.
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

    rod, winch = scenario.compensator, scenario.winch

    def gas(extension: float) -> float:
        """Energy of the gas, polytropic [J]."""
        if rod is None:
            return 0.0
        kappa, g = rod.polytropic_exponent, rod.gas_length
        force = scenario.static_tension if rod.force is None else rod.force
        return force * g / (kappa - 1.0) * (1.0 + extension / g) ** (1.0 - kappa)

    def where() -> tuple[float, float]:
        extension = float(plant.channel("compensator_displacement")[0]) if rod is not None else 0.0
        return extension, float(plant.channel("winch_displacement")[0])

    balance, before, (c0, u0) = Balance(), with_top(nodes()), where()
    begun = stored(*before) + gas(c0)
    for _ in range(scenario.n_steps):
        boom_tip = float(plant.channel("boom_tip_heave")[0] + plant.channel("winch_displacement")[0])
        plant.advance(np.array([-0.5 * boom_tip / scenario.winch.command_range]))
        now, (c1, u1) = with_top(nodes()), where()
        (U0, W0, L0, a0), (U1, W1, L1, a1) = before, now
        T, V = float(plant.channel("sheave_tension")[0]), (L1 - L0) / dt
        L, W = 0.5 * (L0 + L1), 0.5 * (W0 + W1)
        e0, e1 = np.diff(U0) * n / L0, np.diff(U1) * n / L1
        by_damping = damped(cable, e0, e1, dt) * L / n
        if cable.tension_only:
            e0, e1 = np.maximum(e0, 0.0), np.maximum(e1, 0.0)
        strain = 0.5 * float(1.5 * (e0[0] + e1[0]) - 0.5 * (e0[1] + e1[1]))  # at the sheave
        drag = cable.tangential_drag_per_length * L / n * share
        drag[-1] += payload.drag_factor
        by_boom_tip, by_winch = -T * (U1[0] - U0[0] + c1 - c0), -T * V * dt
        by_drag = float(np.sum(drag * np.abs(W) ** 3)) * dt
        if not cable.is_hookean:
            middle = 0.5 * (a0 + a1)
            by_damping += cable.relaxing_stiffness / cable.relaxation_time * np.sum(middle**2) * L / n * dt
        carried = 0.5 * cable.inertia_per_length * W[0] ** 2 + float(
            constitutive.stored_energy(cable, strain)
        )
        carried -= cable.submerged_weight * 0.5 * (U0[0] + U1[0])
        balance.by_boom_tip += float(by_boom_tip)
        balance.by_rod += rod.damping * (c1 - c0) ** 2 / dt if rod is not None else 0.0
        balance.slack += float(plant.channel("slack")[0]) / scenario.n_steps
        work = T * (u1 - u0)
        supply = work / winch.efficiency if work > 0.0 else work * winch.regeneration
        shown = sum(float(plant.channel(name)[0]) for name in ("winch_power", "supply_power")) * dt
        balance.out_of_line += abs(shown - work - supply)
        balance.by_winch += by_winch
        balance.by_drag += by_drag
        balance.by_damping += float(by_damping)
        balance.carried_in += float(carried - T * strain) * V * dt
        before, c0, u0 = now, c1, u1
    balance.stored = stored(*before) + gas(c0) - begun
    return balance


ROPE = {
    "cable.axial_stiffness": 4e6,
    "cable.quadratic_hardening": 10.0,
    "cable.cubic_hardening": 100.0,
    "cable.relaxing_stiffness": 2e6,
    "cable.relaxation_time": 10.0,
}
ROD = {"compensator": {"gas_volume": 2.0, "piston_area": 0.05, "stroke": 8.0, "damping": 2e4}}
REAL_WINCH = {
    "winch.time_constant": None,
    "winch.natural_omega": 2.0,
    "winch.speed_limit": 0.5,
    "winch.acceleration_limit": 0.3,
    "winch.dead_band": 0.01,
    "winch.command_step": 0.005,
    "winch.efficiency": 0.7,
    "winch.regeneration": 0.4,
}
PAY_OUT = {"pay_out": {"speed": 0.5, "start": 20.0, "distance": 60.0, "ramp": 10.0}}
HARDENING = {"cable.quadratic_hardening": 10.0, "cable.cubic_hardening": 100.0}
NO_LOSS_OF_CABLE = {"cable.breaking_strength": None}


@pytest.mark.parametrize(
    ("name", "what", "changes"),
    [
        ("thesis_cable", "pressed", {}),
        ("sea_state_5", "", {}),
        ("deep_resonance", "", {}),
        ("lowering", "", {}),
        ("lowering", "rope", ROPE),
        ("landing", "", {}),
        ("snap", "slack", NO_LOSS_OF_CABLE),
        ("snap", "slack, hardening", NO_LOSS_OF_CABLE | HARDENING),
        ("sea_state_5", "winch", REAL_WINCH),
        ("sea_state_5", "compensator", ROD),
        ("lowering", "compensator, winch, pay-out, rope", ROD | REAL_WINCH | PAY_OUT | ROPE),
        ("snap", "compensator, slack, winch", ROD | REAL_WINCH | NO_LOSS_OF_CABLE),
    ],
)
def test_work_of_boom_tip_and_winch_is_drag_damping_and_stored_energy(name, what, changes):
    scenario = with_values(load(name), {"n_iterations": 10} | changes)
    balance = audit(scenario, 1, 200.0)
    lost = balance.by_drag + balance.by_damping + balance.by_rod
    label = f"{name} ({what})" if what else name
    print(f"{label}: {balance}; left over {100 * balance.left_over / lost:.3f} % of what was lost")
    # Measured against the least of the parts, which the works of boom tip and winch exceed many times over.
    assert abs(balance.left_over) < 5e-3 * lost
    assert (balance.slack > 0.01) == ("slack" in what or "pressed" in what)
    assert balance.out_of_line < 1e-6 * abs(balance.by_winch)


def test_without_drag_and_damping_nothing_is_lost():
    scenario = load("lowering")
    cable = dataclasses.replace(scenario.cable, tangential_drag_coefficient=0.0, axial_damping=0.0)
    payload = dataclasses.replace(scenario.payload, drag_area=0.0)
    dragless = dataclasses.replace(scenario, cable=cable, payload=payload, n_iterations=10)
    balance = audit(dragless, 1, 100.0)
    assert balance.by_drag == balance.by_damping == 0.0
    print(f"without drag: left over {100 * balance.left_over / abs(balance.stored):.4f} % of what was stored")
    assert abs(balance.left_over) < 1e-4 * abs(balance.stored)
