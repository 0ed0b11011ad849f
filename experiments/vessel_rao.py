"""The shipped example vessel: a ship-shaped hull in the boundary-element code Capytaine.

    python -m experiments.vessel_rao table.csv

writes what `heave_env/data/vessels/construction_vessel.csv` holds (Capytaine 3.0.0, minutes on one core).
The hull is our own, of a size that offshore construction vessels have: half breadth

    y(x, z) = (B/2) (1 - |2x/L|⁴) (1 - (z/T)⁶),    -T <= z <= 0,

L = 100 m, B = 22 m, T = 6.5 m: block coefficient 0.686. Linear potential theory in deep water without
forward speed. Roll has 5 % of its critical damping beside radiation, for what potential theory lacks (bilge
keels, eddies); nothing else is added. Capytaine's motions are those of exp(-iωt); the table's are those of
exp(+iωt), the complex conjugates, so that a positive phase leads the wave at the reference point.

Source: Babarit and Delhommeau (2015); Ancellin and Dias (2019).
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

from heave_env.files import write_atomic
from heave_env.parameters import GRAVITY, SEAWATER_DENSITY
from heave_env.sea import Array

LENGTH, BREADTH, DRAUGHT = 100.0, 22.0, 6.5
"""Hull on the waterline [m]."""
METACENTRIC_HEIGHT = 2.0
"""Transverse, GM [m]: places the centre of gravity."""
ROLL_GYRADIUS, PITCH_GYRADIUS = 0.38 * BREADTH, 0.25 * LENGTH
"""Of the dry mass about the centre of gravity [m]."""
ROLL_DAMPING_RATIO = 0.05
"""Of critical, beside radiation [-]."""
HEADINGS = np.radians(np.arange(0.0, 181.0, 30.0))
"""Where the waves travel to, from the bow [rad]: 0 following, π/2 towards port, π head."""
OMEGAS = np.concatenate([np.arange(0.2, 1.4, 0.03), np.arange(1.4, 2.21, 0.1)]).round(3)
"""[rad/s]."""
N_ALONG, N_DOWN = 60, 12
"""Panels along the hull and down one side."""


def half_breadth(x: Array, z: Array) -> Array:
    """Half breadth of the hull at x forward of midships and z above the waterline [m]."""
    fullness = (1.0 - np.abs(2.0 * x / LENGTH) ** 4) * (1.0 - np.abs(z / DRAUGHT) ** 6)
    return np.asarray(0.5 * BREADTH * fullness)


def panels() -> tuple[Array, Array]:
    """Vertices (n, 3) [m] and quadrilaterals (m, 4) of the wetted hull's port side, normals outwards."""
    along = -0.5 * LENGTH * np.cos(np.linspace(0.0, math.pi, N_ALONG + 1))
    down = -DRAUGHT * np.sin(np.linspace(0.0, 0.5 * math.pi, N_DOWN + 1))
    x, z = (grid.ravel() for grid in np.meshgrid(along, down, indexing="ij"))
    first = np.arange(N_ALONG * (N_DOWN + 1)).reshape(N_ALONG, -1)[:, :N_DOWN].ravel()
    faces = np.stack([first + N_DOWN + 1, first + N_DOWN + 2, first + 1, first], axis=1)
    return np.column_stack([x, half_breadth(x, z), z]), faces


def hydrostatics() -> tuple[float, float, Array]:
    """Mass [kg], height of the centre of gravity [m] and stiffness of the six motions, of the hull's formula.

    Surge, sway and yaw have no stiffness; heave does not couple with pitch, since bow and stern are alike.
    """
    x, z = np.linspace(-0.5, 0.5, 4001) * LENGTH, np.linspace(-DRAUGHT, 0.0, 4001)
    waterline, depth = half_breadth(x, np.zeros(1)), half_breadth(np.zeros(1), z) / (0.5 * BREADTH)
    area = 2.0 * np.trapezoid(waterline, x)
    volume = area * np.trapezoid(depth, z)
    buoyancy = np.trapezoid(depth * z, z) / np.trapezoid(depth, z)
    across = np.trapezoid(2.0 / 3.0 * waterline**3, x) / volume
    along = np.trapezoid(2.0 * waterline * x**2, x) / volume
    centre = buoyancy + across - METACENTRIC_HEIGHT
    weight = SEAWATER_DENSITY * GRAVITY * volume
    heave = SEAWATER_DENSITY * GRAVITY * area
    pitch = weight * (buoyancy + along - centre)
    restoring = np.array([0.0, 0.0, heave, weight * METACENTRIC_HEIGHT, pitch, 0.0])
    return float(SEAWATER_DENSITY * volume), float(centre), restoring


def responses() -> Array:
    """Complex heave [m/m], roll [rad/m] and pitch [rad/m], of exp(+iωt), (n_headings, n_omega, 3)."""
    import capytaine
    import xarray
    from capytaine.post_pro import rao

    capytaine.set_logging("ERROR")
    vertices, faces = panels()
    half = capytaine.Mesh(vertices, faces)
    mesh = capytaine.ReflectionSymmetricMesh(half, plane="xOz")
    lid = capytaine.ReflectionSymmetricMesh(half.generate_lid(), plane="xOz")
    mass, centre, restoring = hydrostatics()
    body = capytaine.FloatingBody(
        mesh=mesh,
        lid_mesh=lid,
        dofs=capytaine.rigid_body_dofs(rotation_center=(0.0, 0.0, centre)),
        center_of_mass=(0.0, 0.0, centre),
        mass=mass,
        name="construction_vessel",
    )
    dofs = list(body.dofs)
    inertia = mass * np.diag([1.0, 1.0, 1.0, ROLL_GYRADIUS**2, PITCH_GYRADIUS**2, PITCH_GYRADIUS**2])
    problems: list[object] = []
    for omega in OMEGAS:
        fluid = {"body": body, "omega": float(omega), "rho": SEAWATER_DENSITY, "g": GRAVITY}
        problems += [capytaine.RadiationProblem(radiating_dof=dof, **fluid) for dof in dofs]
        problems += [capytaine.DiffractionProblem(wave_direction=float(b), **fluid) for b in HEADINGS]
    results = capytaine.BEMSolver().solve_all(problems, n_jobs=1, progress_bar=False)
    data = capytaine.assemble_dataset(results)
    added = data["added_mass"].sel(influenced_dof="Roll", radiating_dof="Roll")
    damping = np.zeros((6, 6))
    damping[3, 3] = (
        2.0 * ROLL_DAMPING_RATIO * math.sqrt(restoring[3] * (inertia[3, 3] + float(added.interp(omega=0.5))))
    )
    coordinates = {"influenced_dof": dofs, "radiating_dof": dofs}
    inertias, stiffness, dissipation = (
        xarray.DataArray(matrix, coords=coordinates, dims=tuple(coordinates))
        for matrix in (inertia, np.diag(restoring), damping)
    )
    data = data.assign(inertia_matrix=inertias, hydrostatic_stiffness=stiffness)
    motions = rao(data, dissipation=dissipation).transpose("wave_direction", "omega", "radiating_dof")
    picked = np.conj(motions.sel(radiating_dof=["Heave", "Roll", "Pitch"]).values)
    # A hull that is alike on both sides does not roll in waves from ahead and astern, but for rounding.
    picked[[0, -1], :, 1] = 0.0
    return np.asarray(picked)


def table(motions: Array) -> str:
    """The CSV of responses on the grid of headings and frequencies."""
    import capytaine

    lines = [
        "# Heave, roll and pitch per metre of wave amplitude of a ship-shaped hull of our own.",
        f"# L {LENGTH:g} m, B {BREADTH:g} m, T {DRAUGHT:g} m, GM {METACENTRIC_HEIGHT:g} m; "
        "deep water, no speed.",
        f"# Capytaine {capytaine.__version__}, python -m experiments.vessel_rao; roll with "
        f"{100 * ROLL_DAMPING_RATIO:g} % extra damping.",
        "# Reference point: midships on the centre line, axes x forward, y to port, z up. Phases lead the",
        "# wave there. heading: where the waves travel to, from the bow. Units: rad, rad/s, m/m, rad/m.",
        "heading,omega,heave_amplitude,heave_phase,roll_amplitude,roll_phase,pitch_amplitude,pitch_phase",
    ]
    for heading, rows in zip(HEADINGS.tolist(), motions, strict=True):
        for omega, row in zip(OMEGAS, rows, strict=True):
            amplitude = np.where(np.abs(row) < 1e-6, 0.0, np.abs(row))
            phase = np.where(amplitude == 0.0, 0.0, np.angle(row))
            cells = [f"{a:.6g},{p:.4f}" for a, p in zip(amplitude, phase, strict=True)]
            lines.append(f"{heading!r},{omega:.4g}," + ",".join(cells))
    return "\n".join(lines) + "\n"


def main() -> None:
    """Writes the table to the file that the command line names."""
    if len(sys.argv) != 2:
        sys.exit("usage: python -m experiments.vessel_rao TABLE.csv")
    write_atomic(Path(sys.argv[1]), table(responses()).encode())


if __name__ == "__main__":
    main()
