"""3-D line of point masses joined by elastic segments: free, held or driven ends, slack, varying length.

Node i has position r and velocity v, segment j joins nodes j and j + 1, t is its unit tangent, P = I - t tᵀ
projects on the plane normal to it, l is its unstretched length. Half of each segment's mass, weight, added
mass and drag belongs to either of its nodes:

    (m_i + body) dv_i/dt + Σ (1/2) l_j (m_N P_j + m_a t_j t_jᵀ) dv_i/dt
                    = T_i t_i - T_{i-1} t_{i-1} + weight + Σ (1/2) l_j f(U - v_i, t_j) + body's drag
    T = EA e + C_A De/Dt,  e = |r_{j+1} - r_j| / l_j - 1  (T = 0 where slack, if the cable is tension-only)

A rope that hardens and relaxes has a Maxwell branch in each segment (`constitutive`).

f is the drag of `hydrodynamics.line_drag`, with each node's own velocity and the tangents of its two
segments: the thesis averages the velocities of the two nodes of a segment, which leaves neighbours that move
against each other undamped. A body's drag falls apart into a horizontal and a vertical one, or as
`body_drag` says. The water's acceleration exerts no force (no Froude-Krylov term).

Source: Huang (1992), chapter 5, (5.1)-(5.6), in vectors: the angles of his matrices are misprinted.

Varying length: material enters and leaves at the sheave, so that only the uppermost segment grows or
shrinks. Every other node is a fixed material point, whose equation is the one above: L' may jump and L''
never appears. When the uppermost segment exceeds 1.5 of its nominal length it is split; below 0.4 it is
merged with its neighbour (not 0.5, or a winch about that length would split and merge all the time).
A split puts the new node on the straight line between its neighbours, moved to where weight, drag and
inertia balance the two tensions, with the velocity interpolated linearly; a merge gives the velocity that
keeps the momentum. Both keep material and momentum exactly. Rope that enters holds in its Maxwell branch
what the uppermost segment does.

The model stops holding where bending or torsion matters, at a seabed (there is none), and for waves
shorter than some four segments: the chain passes none above ω = (2 / l) sqrt(T / m).
The compiled part is `heave_env/cable/chain.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from heave_env.cable.chain import (
    AXIAL_DRAG,
    AXIAL_MASS,
    BODY_DRAGS,
    BODY_MASS,
    BODY_RISE,
    BODY_RISE_DRAG,
    BODY_SWAY,
    BODY_SWAY_DRAG,
    BODY_WEIGHT,
    MASS,
    NORMAL_DRAG,
    NORMAL_MASS,
    RELAXING_STIFFNESS,
    STIFFNESS,
    TENSION_ONLY,
    WEIGHT,
    Chain,
    Ends,
    Flow,
    Motion,
    Record,
    march,
    settle,
)
from heave_env.cable.constitutive import rope_energy_coefficients, static_tension, stored_energy
from heave_env.cable.convergence import ConvergenceError
from heave_env.hydrodynamics import between_knots, current_knots
from heave_env.parameters import Cable, Current, Line, Payload, require, require_integer, require_number

Array = np.ndarray
Water = Callable[[Array, float], Array]

LOWER_ENDS = ("free", "fixed", "driven")
UPPER_ENDS = ("driven", "fixed", "free")


@dataclass(frozen=True, eq=False)
class LineState:
    """The line at an instant: a value that copies and compares. Node 0 is the lower end."""

    time: float
    """The instant [s]."""
    positions: Array
    """Nodes [m], (n_nodes, 3): x, y horizontal, z up from the mean surface."""
    velocities: Array
    """Velocities of the nodes [m/s], (n_nodes, 3)."""
    accelerations: Array
    """Mean accelerations over the last step [m/s²], (n_nodes, 3)."""
    segment_lengths: Array
    """Unstretched lengths [m], (n_segments,)."""
    tensions: Array
    """Tension at the middle of each segment, mean over the last step [N], (n_segments,)."""
    bottom_force: Array
    """Force in the cable at its lower end, directed up along it, mean over the last step [N], (3,)."""
    top_force: Array
    """Force in the cable at its upper end, directed up along it, mean over the last step [N], (3,)."""
    branch_strains: Array = field(default_factory=lambda: np.empty(0))
    """Strain that each segment's Maxwell branch holds [-], (n_segments,); empty: none holds any."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, LineState):
            return NotImplemented
        names = list(self.__dataclass_fields__)
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names)

    @property
    def length(self) -> float:
        """Unstretched length of the line [m]."""
        return float(np.sum(self.segment_lengths))

    @property
    def arc_lengths(self) -> Array:
        """Unstretched distance of each node from the lower end [m], (n_nodes,)."""
        return np.concatenate([[0.0], np.cumsum(self.segment_lengths)])


@dataclass(frozen=True)
class LineRecord:
    """What a march recorded; the first axis is time, beginning with the instant that it started from.

    While length changes the number of nodes does: nodes not paid out stand at the sheave, segments not paid
    out carry the uppermost tension.
    """

    time: Array
    """Instants [s], (n_times,)."""
    positions: Array
    """Nodes [m], (n_times, n_nodes, 3)."""
    velocities: Array
    """Velocities of the nodes [m/s], (n_times, n_nodes, 3)."""
    segment_tensions: Array
    """Tension at the middle of each segment, mean over the step [N], (n_times, n_segments)."""
    bottom_force: Array
    """Force in the cable at its lower end, directed up along it [N], (n_times, 3)."""
    top_force: Array
    """Force in the cable at its upper end, directed up along it [N], (n_times, 3)."""
    least_tension: Array
    """Smallest tension of any segment since the last recorded instant [N], (n_times,)."""
    greatest_tension: Array
    """Largest tension anywhere since the last recorded instant [N], (n_times,)."""
    n_segments: Array
    """Segments paid out [-], (n_times,)."""
    length: Array
    """Unstretched length [m], (n_times,)."""
    end: LineState
    """The state at the last step."""

    @property
    def payload_position(self) -> Array:
        """Lower end [m], (n_times, 3)."""
        return self.positions[:, 0]

    @property
    def payload_velocity(self) -> Array:
        """Velocity of the lower end [m/s], (n_times, 3)."""
        return self.velocities[:, 0]

    @property
    def top_tension(self) -> Array:
        """Tension at the upper end [N], (n_times,)."""
        return np.linalg.norm(self.top_force, axis=1)

    @property
    def payload_tension(self) -> Array:
        """Tension at the lower end [N], (n_times,)."""
        return np.linalg.norm(self.bottom_force, axis=1)


@dataclass(frozen=True, kw_only=True)
class LumpedMassSolver:
    """A line in three dimensions: point masses joined by elastic segments.

    Implicit midpoint in time with the tension's discrete gradient, Newton with a block-tridiagonal Jacobian;
    second order in time and space, unconditionally stable, without algorithmic damping: in air, between ends
    that stand still, energy is kept to rounding, through slack and snap too. A step whose Newton does not
    settle is halved, down to 1/256 of itself.

    A slack line wants a tension-only cable with Kelvin damping of some milliseconds (C_A = EA · 5 ms).
    """

    line: Line
    """Sections and attached bodies; each body goes to the nearest node."""
    n_segments: int = 40
    """Segments over the line, shared out among its sections by length, at least one each [-]."""
    current: Current = field(default_factory=Current)
    """The current."""
    water: Water | None = None
    """Velocity of the water in place of `current`: a function of positions [m], (n_nodes, 3), and time [s]
    that returns (n_nodes, 3) [m/s]; called once per step, so the march is no longer one compiled loop."""
    lower: str = "free"
    """Lower end: `free` (with the payload, if any), `fixed` where it is, or `driven` by a given motion."""
    upper: str = "driven"
    """Upper end: `driven` by a given motion, `fixed`, or `free`."""
    payload: Payload | None = None
    """Body at a free lower end."""
    body_drag: str = "components"
    """Drag of bodies: `components` (horizontal and vertical each on its own), `axes` (x, y and z each on its
    own, as in the thesis; it depends on the axes) or `vector` (along the relative velocity)."""
    tolerance: float = 1e-9
    """Newton stops when its correction is below this fraction of a segment [-]; the error is far below."""

    def __post_init__(self) -> None:
        require_integer(self, "n_segments", minimum=1)
        require_number(self, "tolerance", positive=True)
        require(self.lower in LOWER_ENDS, self, "lower", f"one of {', '.join(LOWER_ENDS)}")
        require(self.upper in UPPER_ENDS, self, "upper", f"one of {', '.join(UPPER_ENDS)}")
        require(self.body_drag in BODY_DRAGS, self, "body_drag", f"one of {', '.join(BODY_DRAGS)}")
        if self.lower != "free":
            require(self.payload is None, self, "payload", "null unless the lower end is free")
        if (
            self.payload is None
            and self.lower == "free"
            and self.line.sections[0].cable.mass_per_length == 0.0
        ):
            require(False, self, "payload", "given, since a free end of a massless cable has no inertia")

    @cached_property
    def _counts(self) -> list[int]:
        total = self.line.length
        return [max(1, round(self.n_segments * section.length / total)) for section in self.line.sections]

    @cached_property
    def _rest_lengths(self) -> Array:
        shares = zip(self.line.sections, self._counts, strict=True)
        return np.concatenate([np.full(count, section.length / count) for section, count in shares])

    @cached_property
    def nominal_length(self) -> float:
        """Unstretched length of a segment of the uppermost section [m]."""
        return float(self._rest_lengths[-1])

    @cached_property
    def _law(self) -> Array:
        rows = []
        for section, count in zip(self.line.sections, self._counts, strict=True):
            cable = section.cable
            row = [
                cable.mass_per_length,
                cable.submerged_weight,
                cable.axial_stiffness,
                cable.axial_damping,
                cable.normal_added_mass_per_length,
                cable.added_mass_per_length,
                cable.normal_drag_per_length,
                cable.tangential_drag_per_length,
                float(cable.tension_only),
                *rope_energy_coefficients(cable),
                cable.relaxing_stiffness,
                1.0 / cable.relaxation_time,
            ]
            rows += [row] * count
        return np.array(rows)

    @cached_property
    def _hookean(self) -> bool:
        return all(section.cable.is_hookean for section in self.line.sections)

    def _parts(self, n: int) -> list[tuple[Cable, slice]]:
        """Each section's cable and its segments among n: the uppermost has what the others leave."""
        ends = [*np.cumsum(self._counts)[:-1].tolist(), n]
        cables = [section.cable for section in self.line.sections]
        return [
            (cable, slice(begin, end))
            for cable, begin, end in zip(cables, [0, *ends[:-1]], ends, strict=True)
        ]

    @cached_property
    def _bodies(self) -> Array:
        arcs = np.concatenate([[0.0], np.cumsum(self._rest_lengths)])
        bodies = np.zeros((len(arcs), 6))
        placed = [(attachment.arc_length, attachment.body) for attachment in self.line.attachments]
        if self.payload is not None:
            placed.append((0.0, self.payload))
        for arc, body in placed:
            lateral = body.lateral_inertia - body.mass
            numbers = [body.mass, body.added_mass, lateral, body.submerged_weight]
            numbers += [body.drag_factor, body.lateral_drag_factor]
            bodies[int(np.argmin(np.abs(arcs - arc)))] += numbers
        return bodies

    @cached_property
    def _least_length(self) -> float:
        """How short the line may become: what is below the uppermost section and its bodies, and a little."""
        lower_sections = self.line.length - self.line.sections[-1].length
        bodies = [attachment.arc_length for attachment in self.line.attachments]
        return max([lower_sections, *bodies]) + 2.0 * self.nominal_length

    def _held(self) -> tuple[bool, bool]:
        return self.lower != "free", self.upper != "free"

    def rest(
        self,
        top: Array | tuple[float, float, float] | None = (0.0, 0.0, 0.0),
        bottom: Array | tuple[float, float, float] | None = None,
        *,
        time: float = 0.0,
    ) -> LineState:
        """Static equilibrium in the current as it is at `time`.

        Args:
            top: Position of a held upper end [m], (3,); not looked at if it is free.
            bottom: Position of a held lower end [m], (3,); not looked at if it is free.
            time: The instant [s].

        Raises:
            ValueError: If no end is held, a held end has no position, or the ends are too far apart.
            ConvergenceError: If no equilibrium is found; the residual is the largest force left over [N].
        """
        lower_held, upper_held = self._held()
        if not (lower_held or upper_held):
            raise ValueError("rest() needs a held end: set upper or lower to 'fixed' or 'driven'")
        high = _point("top", top) if upper_held else None
        low = _point("bottom", bottom) if lower_held else None
        r = self._first_shape(high, low)
        if self.water is None:
            flow = self._flow()
            return self._settled(r, flow, float(between_knots(time, flow.knots, flow.factors)), time)
        # The relaxation knows a profile over depth only: one through the nodes stands in for the water.
        moved = math.inf
        for _ in range(60):
            given = np.asarray(self.water(r, time), dtype=float)
            order = np.argsort(-r[:, 2], kind="stable")
            depth = -r[order, 2]
            keep = np.concatenate([[True], np.diff(depth) > 1e-9])
            knots = (depth[keep], given[order, 0][keep], given[order, 1][keep])
            state = self._settled(r.copy(), self._flow(knots), 1.0, time)
            moved, r = float(np.max(np.abs(state.positions - r))), state.positions
            if moved < 1e-6 * self.nominal_length:
                return state
        raise ConvergenceError(
            "the static shape in the given water did not settle; if its velocity is not horizontal or varies "
            "along the horizontal, march to the steady state instead; last movement in m",
            moved,
        )

    def _flow(self, knots: tuple[Array, Array, Array] | None = None, given: Array | None = None) -> Flow:
        table = current_knots(self.current) if knots is None else knots
        times, factors = np.array(self.current.time, float), np.array(self.current.factor, float)
        return Flow(*table, times, factors, np.zeros((0, 3)) if given is None else given)

    def _chain(self, n: int, nominal: float) -> Chain:
        """Numbers of n segments and n + 1 nodes: what is beyond the first is of the uppermost section."""
        law, bodies = self._law, self._bodies
        if n > len(law):
            law = np.vstack([law, np.repeat(law[-1:], n - len(law), axis=0)])
            bodies = np.vstack([bodies, np.zeros((n + 1 - len(bodies), bodies.shape[1]))])
        kind = BODY_DRAGS.index(self.body_drag)
        return Chain(law[:n].copy(), bodies[: n + 1].copy(), nominal, self.tolerance, kind, self._hookean)

    def _settled(self, r: Array, flow: Flow, factor: float, time: float) -> LineState:
        """Static equilibrium from a first shape."""
        lengths = self._rest_lengths.copy()
        n = len(lengths)
        chain = self._chain(n, float(np.mean(lengths)))
        law, bodies = chain.law, chain.bodies
        fastest = float(np.max(np.hypot(flow.along_x, flow.along_y))) * abs(factor)
        drag = float(np.sum(lengths * (law[:, NORMAL_DRAG] + law[:, AXIAL_DRAG])))
        drag += float(np.sum(bodies[:, BODY_RISE_DRAG] + bodies[:, BODY_SWAY_DRAG]))
        weights = np.sum(np.abs(lengths * law[:, WEIGHT])) + np.sum(np.abs(bodies[:, BODY_WEIGHT]))
        # A weightless line between ends has no other force than its own.
        scale = max(float(weights) + drag * fastest**2, 1e-6 * float(np.min(law[:, STIFFNESS])))

        def relaxed(shape: Array, chain: Chain) -> tuple[float, LineState]:
            bottom_force, top_force, tension = np.zeros(3), np.zeros(3), np.zeros(n)
            motion = Motion(shape, np.zeros_like(shape), np.zeros_like(shape), lengths, np.zeros(n))
            residual = settle(
                n, *self._held(), motion, chain, flow, factor, scale, bottom_force, top_force, tension
            )
            forces = (lengths, tension, bottom_force, top_force)
            return residual, LineState(time, shape, motion.v, motion.acceleration, *forces)

        residual, state = relaxed(r.copy(), chain)
        if not (residual < np.inf and np.min(state.tensions) >= -1e-9 * scale):
            # Compressed, as a straight line beneath a float stands on a knife's edge: off it by a bow, with a
            # cable that cannot be, and from there with the true one.
            limp = chain._replace(law=law.copy())
            limp.law[:, TENSION_ONLY] = 1.0
            bow = 1e-2 * self.line.length * np.sin(np.linspace(0.0, np.pi, n + 1))
            aside = r + bow[:, None] * [0.6, 0.8, 0.0]
            again, other = relaxed(relaxed(aside, limp)[1].positions, chain)
            if again <= max(residual, 1e-6 * scale) and np.min(other.tensions) > np.min(state.tensions):
                residual, state = again, other
        # Rounding of positions alone leaves EA · 1e-16 · |r| / l.
        rounding = float(np.max(law[:, STIFFNESS] / lengths)) * float(np.max(np.abs(state.positions))) * 1e-14
        if not residual <= 1e-6 * scale + rounding:
            raise ConvergenceError(
                "no static equilibrium of the line was found; a net weight of nearly zero or a current that "
                "varies sharply over a segment is the likely cause: raise n_segments, or march from a given "
                f"shape with placed(); force left over in N, of {scale:.3g} N acting",
                residual,
            )
        return state

    def placed(self, positions: Array, velocities: Array | None = None, *, time: float = 0.0) -> LineState:
        """A state of given nodes, to march from; tensions are those of its strains.

        Args:
            positions: Nodes, the lower end first [m], (n_nodes, 3), see `node_arc_lengths`.
            velocities: Their velocities [m/s], same shape; zero if not given.
            time: The instant [s].
        """
        r = np.array(positions, dtype=float)
        v = np.zeros_like(r) if velocities is None else np.array(velocities, dtype=float)
        n = len(self._rest_lengths)
        for name, values in (("positions", r), ("velocities", v)):
            if values.shape != (n + 1, 3) or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} must be finite numbers of shape ({n + 1}, 3), got {values.shape}")
        across = np.diff(r, axis=0)
        stretched = np.maximum(np.linalg.norm(across, axis=1), 1e-300)
        strain = stretched / self._rest_lengths - 1.0
        tension = np.concatenate([static_tension(cable, strain[of]) for cable, of in self._parts(n)])
        pull = (tension / stretched)[:, None] * across
        return LineState(time, r, v, np.zeros_like(r), self._rest_lengths.copy(), tension, pull[0], pull[-1])

    @property
    def node_arc_lengths(self) -> Array:
        """Unstretched distance of the nodes from the lower end at the start [m], (n_nodes,)."""
        return np.concatenate([[0.0], np.cumsum(self._rest_lengths)])

    def _first_shape(self, top: Array | None, bottom: Array | None) -> Array:
        """A guess of the static shape: taut, hanging straight, or a parabola of the right length."""
        lengths, total = self._rest_lengths, self.line.length
        arcs = np.concatenate([[0.0], np.cumsum(lengths)])
        weight = float(np.sum(lengths * self._law[:, WEIGHT]) + np.sum(self._bodies[:, BODY_WEIGHT]))
        down = np.array([0.0, 0.0, -1.0 if weight >= 0.0 else 1.0])
        if top is None or bottom is None:
            if top is not None:
                return top + (total - arcs)[:, None] * down
            assert bottom is not None
            # Standing on its lower end: a line that floats goes up, one that sinks hangs from it.
            return bottom + arcs[:, None] * down
        chord = top - bottom
        span = float(np.linalg.norm(chord))
        if span > 1.5 * total:
            raise ValueError(
                f"the ends are {span:g} m apart, more than the line of {total:g} m stretches: give a longer "
                "line or nearer ends"
            )
        along = arcs / total
        straight = bottom + along[:, None] * chord
        if span >= total:
            return straight
        side = down - chord * float(down @ chord) / max(span**2, 1e-300)
        if np.linalg.norm(side) < 1e-3:
            side = np.array([1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        bulge = 4.0 * along * (1.0 - along)
        low, high = 0.0, total
        for _ in range(60):
            sag = 0.5 * (low + high)
            pieces = np.diff(straight + sag * bulge[:, None] * side, axis=0)
            low, high = (sag, high) if np.linalg.norm(pieces, axis=1).sum() < total else (low, sag)
        return straight + sag * bulge[:, None] * side

    def step(
        self,
        state: LineState,
        top: Array | tuple[float, float, float] | None,
        dt: float,
        *,
        bottom: Array | tuple[float, float, float] | None = None,
        length: float | None = None,
    ) -> LineState:
        """Advances by `dt` [s].

        Args:
            state: The instant to go on from.
            top: Position of a driven upper end at the end of the step [m], (3,).
            dt: Time step [s].
            bottom: Position of a driven lower end at the end of the step [m], (3,).
            length: Unstretched length at the end of the step [m]; as it is if not given.
        """
        tops = None if top is None else np.array([state.positions[-1], _point("top", top)])
        bottoms = None if bottom is None else np.array([state.positions[0], _point("bottom", bottom)])
        lengths = None if length is None else np.array([state.length, length])
        record = self.simulate(tops, dt=dt, n_steps=1, bottom=bottoms, length=lengths, start=state)
        return record.end

    def top_tension(self, state: LineState) -> float:
        """Tension at the upper end, mean over the last step [N]."""
        return float(np.linalg.norm(state.top_force))

    def payload_motion(self, state: LineState) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s] of the lower end, each (3,)."""
        return state.positions[0].copy(), state.velocities[0].copy()

    def energy(self, state: LineState) -> float:
        """Kinetic (with added mass), elastic and potential energy [J]; potential is zero at z = 0.

        Of a rope the elastic energy is that of its spring and of its Maxwell branches.
        """
        lengths = state.segment_lengths
        chain = self._chain(len(lengths), self.nominal_length)
        law, bodies = chain.law, chain.bodies
        across = np.diff(state.positions, axis=0)
        stretched = np.linalg.norm(across, axis=1)
        strain = stretched / lengths - 1.0
        parts = self._parts(len(lengths))
        stored = np.concatenate([stored_energy(cable, strain[of]) for cable, of in parts])
        energy = float(np.sum(stored * lengths))
        if len(state.branch_strains) > 0:
            energy += float(np.sum(0.5 * law[:, RELAXING_STIFFNESS] * state.branch_strains**2 * lengths))
        tangent = across / stretched[:, None]
        for end in (slice(None, -1), slice(1, None)):
            v = state.velocities[end]
            along = np.sum(v * tangent, axis=1)
            square = np.sum(v**2, axis=1)
            inertia = (law[:, MASS] + law[:, NORMAL_MASS]) * square
            inertia += (law[:, AXIAL_MASS] - law[:, NORMAL_MASS]) * along**2
            height = state.positions[end][:, 2]
            energy += float(np.sum(0.5 * lengths * (0.5 * inertia + law[:, WEIGHT] * height)))
        flat = np.sum(state.velocities[:, :2] ** 2, axis=1)
        sway, rise = (
            bodies[:, BODY_MASS] + bodies[:, BODY_SWAY],
            bodies[:, BODY_MASS] + bodies[:, BODY_RISE],
        )
        energy += float(np.sum(0.5 * (sway * flat + rise * state.velocities[:, 2] ** 2)))
        return energy + float(np.sum(bodies[:, BODY_WEIGHT] * state.positions[:, 2]))

    def simulate(
        self,
        top: Array | tuple[float, float, float] | None = None,
        *,
        dt: float,
        n_steps: int | None = None,
        bottom: Array | tuple[float, float, float] | None = None,
        length: Array | None = None,
        start: LineState | None = None,
        every: int = 1,
    ) -> LineRecord:
        """Marches through given motions of the ends.

        Args:
            top: Positions of the upper end at each instant [m], (n_steps + 1, 3); (3,) if it stands still.
            dt: Time step [s].
            n_steps: Steps [-]; needed if neither `top`, `bottom` nor `length` tells.
            bottom: Positions of the lower end, likewise.
            length: Unstretched length at each instant [m], (n_steps + 1,); constant if not given.
            start: The state to begin with; `rest` at the first positions if not given.
            every: Steps from one recorded instant to the next [-].

        Returns:
            The record, from the start on.

        Raises:
            ValueError: If arguments contradict each other or the solver.
            ConvergenceError: If Newton does not settle even at a 256th of the step.
        """
        if not (math.isfinite(dt) and dt > 0.0):
            raise ValueError(f"dt must be a positive number of seconds, got {dt!r}")
        if every < 1:
            raise ValueError(f"every must be at least 1, got {every!r}")
        given = {"top": top, "bottom": bottom, "length": length}
        tracks = {
            name: np.asarray(values, dtype=float) for name, values in given.items() if values is not None
        }
        for name, track in tracks.items():
            if not np.all(np.isfinite(track)):
                raise ValueError(f"{name} must hold finite numbers; it holds a NaN or an infinity")
            if name != "length" and (track.shape[-1:] != (3,) or track.ndim not in (1, 2)):
                raise ValueError(f"{name} must have the shape (n_steps + 1, 3) or (3,), got {track.shape}")
        counts = {len(track) - 1 for name, track in tracks.items() if name == "length" or track.ndim == 2}
        if n_steps is not None:
            counts.add(n_steps)
        if len(counts) != 1 or min(counts) < 1:
            raise ValueError(f"top, bottom, length and n_steps must agree on a number of steps, got {counts}")
        n_steps = counts.pop()
        if start is None:
            state = self.rest(
                tracks["top"].reshape(-1, 3)[0] if "top" in tracks else (0.0, 0.0, 0.0),
                tracks["bottom"].reshape(-1, 3)[0] if "bottom" in tracks else None,
            )
        else:
            state = start
        tops = self._track("top", self.upper, tracks.get("top"), state.positions[-1], n_steps)
        bottoms = self._track("bottom", self.lower, tracks.get("bottom"), state.positions[0], n_steps)
        lengths = self._lengths(tracks.get("length"), state.length, n_steps)
        return self._run(state, tops, bottoms, lengths, dt, every)

    def _track(self, name: str, end: str, track: Array | None, where: Array, n_steps: int) -> Array:
        """Positions of an end at every instant, (n_steps + 1, 3)."""
        if track is None or end == "free":
            return np.broadcast_to(where, (n_steps + 1, 3)).copy()
        positions = np.broadcast_to(track, (n_steps + 1, 3)).copy()
        still = end == "fixed" and not np.allclose(positions, positions[0])
        if still:
            raise ValueError(f"{name} moves, but that end is fixed: make it driven")
        away = float(np.linalg.norm(positions[0] - where))
        if away > 1e-6 * self.line.length:
            raise ValueError(f"{name} begins {away:g} m from where the start state has that end: begin there")
        return positions

    def _lengths(self, length: Array | None, now: float, n_steps: int) -> Array:
        if length is None:
            return np.full(n_steps + 1, now)
        if self.upper == "free":
            raise ValueError("length changes at the sheave: the upper end must be driven or fixed for it")
        if abs(float(length[0]) - now) > 1e-6 * now:
            raise ValueError(
                f"length must begin with the start state's {now:g} m, got {float(length[0]):g} m"
            )
        if float(np.min(length)) < self._least_length:
            raise ValueError(
                f"length must not fall below {self._least_length:g} m, where lower sections, bodies or the "
                f"last two segments would be taken in, got {float(np.min(length)):g} m"
            )
        return length

    def _run(
        self, state: LineState, tops: Array, bottoms: Array, lengths: Array, dt: float, every: int
    ) -> LineRecord:
        n, n_steps = len(state.segment_lengths), len(lengths) - 1
        spare = max(0.0, float(np.max(lengths)) - state.length)
        room = n + math.ceil(spare / self.nominal_length) + (2 if np.ptp(lengths) > 0.0 else 0)
        nodes = (state.positions, state.velocities, state.accelerations)
        r, v, a = (_padded(values, room + 1) for values in nodes)
        held = state.branch_strains if len(state.branch_strains) > 0 else np.zeros(n)
        motion = Motion(r, v, a, _padded(state.segment_lengths, room), _padded(held, room))
        chain = self._chain(room, self.nominal_length)
        ends = Ends(bottoms, tops, lengths)
        n_kept = n_steps // every
        record, last = _empty_record(n_kept, room), _empty_record(1, room)

        def go_on(n: int, begin: int, stop: int, flow: Flow, every: int, out: Record) -> int:
            part = Ends(*(values[begin : stop + 1] for values in ends))
            start = state.time + begin * dt
            n, failed, residual = march(n, *self._held(), motion, chain, part, flow, start, dt, every, out)
            if failed < 0:
                return n
            raise ConvergenceError(
                f"the step to {start + failed * dt:g} s did not settle even at a 256th of {dt:g} s; a jump "
                "of an end's motion or a slack cable without Kelvin damping is the likely cause: smooth the "
                "motion, or set axial_damping to some milliseconds of axial_stiffness; force left over in N",
                residual,
            )

        if self.water is None:
            whole = n_kept * every
            if whole > 0:
                n = go_on(n, 0, whole, self._flow(), every, record)
                last = Record(*(values[-1:] for values in record))
            if whole < n_steps:
                last = _empty_record(1, room)
                n = go_on(n, whole, n_steps, self._flow(), n_steps - whole, last)
        else:
            for k in range(n_steps):
                ahead = (r + 0.5 * dt * v)[: n + 1]
                given = np.asarray(self.water(ahead, state.time + (k + 0.5) * dt), dtype=float)
                if given.shape != (n + 1, 3) or not np.all(np.isfinite(given)):
                    raise ValueError(f"water must return finite velocities ({n + 1}, 3), got {given.shape}")
                n = go_on(n, k, k + 1, self._flow(given=_padded(given, room + 1)), 1, last)
                if (k + 1) % every == 0:
                    for kept, one in zip(record, last, strict=True):
                        kept[(k + 1) // every - 1] = one[0]
        end = LineState(
            time=state.time + n_steps * dt,
            positions=r[: n + 1].copy(),
            velocities=v[: n + 1].copy(),
            accelerations=a[: n + 1].copy(),
            segment_lengths=motion.length[:n].copy(),
            tensions=last.tensions[0, :n].copy(),
            bottom_force=last.ends[0, 0:3].copy(),
            top_force=last.ends[0, 3:6].copy(),
            branch_strains=np.empty(0) if self._hookean else motion.branch_strain[:n].copy(),
        )
        forces = [float(np.linalg.norm(force)) for force in (state.top_force, state.bottom_force)]
        extremes = float(np.min(state.tensions)), max(float(np.max(state.tensions)), *forces)
        return LineRecord(
            time=state.time + dt * every * np.arange(n_kept + 1),
            positions=np.concatenate([_padded(state.positions, room + 1)[None], record.positions]),
            velocities=np.concatenate([_padded(state.velocities, room + 1)[None], record.velocities]),
            segment_tensions=np.concatenate([_padded(state.tensions, room)[None], record.tensions]),
            bottom_force=np.vstack([state.bottom_force, record.ends[:, 0:3]]),
            top_force=np.vstack([state.top_force, record.ends[:, 3:6]]),
            least_tension=np.concatenate([[extremes[0]], record.ends[:, 6]]),
            greatest_tension=np.concatenate([[extremes[1]], record.ends[:, 7]]),
            n_segments=np.concatenate([[len(state.tensions)], record.counts]),
            length=lengths[: n_kept * every + 1 : every].copy(),
            end=end,
        )


def _padded(values: Array, rows: int) -> Array:
    """A copy with that many rows, the last repeated."""
    extra = np.repeat(values[-1:], rows - len(values), axis=0)
    return np.concatenate([values, extra]).astype(float)


def _empty_record(n_times: int, room: int) -> Record:
    nodes = (n_times, room + 1, 3)
    return Record(
        positions=np.zeros(nodes),
        velocities=np.zeros(nodes),
        tensions=np.zeros((n_times, room)),
        ends=np.zeros((n_times, 8)),
        counts=np.zeros(n_times, dtype=np.int64),
    )


def _point(name: str, where: Array | tuple[float, float, float] | None) -> Array:
    """A position as an array, (3,)."""
    point = np.array((np.nan,) * 3 if where is None else where, dtype=float)
    if point.shape != (3,) or not np.all(np.isfinite(point)):
        raise ValueError(f"{name} must be a position of three finite numbers in m, got {where!r}")
    return point
