"""Drag of cables and bodies, and the current that they lie in; one place for every solver.

Compiled stages take numbers, so that each hot loop uses the very same formula; the functions below them
take arrays. Axes: x and y horizontal, z up from the mean surface, depth = -z. Velocities are those of the
water relative to the body unless said otherwise, so that drag points with them. Drag acts on the
unstretched length everywhere: the thesis takes three different lengths in its chapters 2, 4 and 5.
"""

from __future__ import annotations

import numpy as np

from heave_env.compiled import stage
from heave_env.parameters import Cable, Current

Array = np.ndarray


@stage
def quadratic_drag(factor, velocity):
    """Drag along one axis, F = factor |v| v, and its derivative by v.

    Source: Morison et al. (1950), drag term, factor = (1/2) ρ C_d S.
    """
    speed = abs(velocity)
    return factor * speed * velocity, 2.0 * factor * speed


@stage
def line_drag(ux, uy, uz, tx, ty, tz, normal_factor, tangential_factor):
    """Drag per unstretched length of a cable, as the three components of a vector.

    f = (1/2) ρ d C_N |U_N| U_N + (π/2) ρ d C_t |U_t| U_t,  U_t = (U·t) t,  U_N = U - U_t

    Source: Huang (1992), (2.46)-(2.47). `u` is the water's velocity relative to the cable, `t` the unit
    tangent, the factors are `Cable.normal_drag_per_length` and `Cable.tangential_drag_per_length`.
    """
    along = ux * tx + uy * ty + uz * tz
    nx, ny, nz = ux - along * tx, uy - along * ty, uz - along * tz
    across = (nx * nx + ny * ny + nz * nz) ** 0.5
    of_normal, of_tangent = normal_factor * across, tangential_factor * abs(along) * along
    return (
        of_normal * nx + of_tangent * tx,
        of_normal * ny + of_tangent * ty,
        of_normal * nz + of_tangent * tz,
    )


@stage
def line_drag_slopes(ux, uy, uz, tx, ty, tz, normal_factor, tangential_factor):
    """Derivatives of `line_drag` by the relative velocity, xx, xy, xz, yy, yz, zz: a symmetric matrix.

    ∂f/∂U = c_N (|U_N| (I - t tᵀ) + U_N U_Nᵀ / |U_N|) + 2 c_t |U_t| t tᵀ; positive semidefinite.
    """
    along = ux * tx + uy * ty + uz * tz
    nx, ny, nz = ux - along * tx, uy - along * ty, uz - along * tz
    across = (nx * nx + ny * ny + nz * nz) ** 0.5
    direct = normal_factor * across
    dyadic = normal_factor / across if across > 0.0 else 0.0
    of_tangent = 2.0 * tangential_factor * abs(along) - direct
    return (
        direct + dyadic * nx * nx + of_tangent * tx * tx,
        dyadic * nx * ny + of_tangent * tx * ty,
        dyadic * nx * nz + of_tangent * tx * tz,
        direct + dyadic * ny * ny + of_tangent * ty * ty,
        dyadic * ny * nz + of_tangent * ty * tz,
        direct + dyadic * nz * nz + of_tangent * tz * tz,
    )


@stage
def between_knots(at, knots, values):
    """Linear interpolation at one point; the end values hold beyond the ends. `knots` increase."""
    n = len(knots)
    if at <= knots[0]:
        return values[0]
    if at >= knots[n - 1]:
        return values[n - 1]
    low, high = 0, n - 1
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle] <= at:
            low = middle
        else:
            high = middle
    share = (at - knots[low]) / (knots[high] - knots[low])
    return (1.0 - share) * values[low] + share * values[high]


def current_knots(current: Current) -> tuple[Array, Array, Array]:
    """Depths and the velocity's x and y components at the profile's knots, for `between_knots`.

    Each of shape (n_knots,); the factor over time is not in them.
    """
    speed, direction = np.array(current.speed), np.array(current.direction)
    return np.array(current.depth, dtype=float), speed * np.cos(direction), speed * np.sin(direction)


def current_factor(current: Current, time: Array | float) -> Array:
    """What multiplies the current's speed at the given instants [-], the shape of `time`."""
    return np.asarray(np.interp(time, current.time, current.factor))


def current_velocity(current: Current, depth: Array | float, time: float = 0.0) -> Array:
    """Velocity of the water [m/s].

    Args:
        current: The current.
        depth: Depth below the mean surface [m], any shape.
        time: The instant [s].

    Returns:
        Components along x, y and z in a last axis of length 3.
    """
    knots, along_x, along_y = current_knots(current)
    factor = current_factor(current, time)
    x, y = np.interp(depth, knots, along_x), np.interp(depth, knots, along_y)
    return np.stack([factor * x, factor * y, np.zeros_like(x)], axis=-1)


def cable_drag(cable: Cable, relative_velocity: Array, tangent: Array) -> Array:
    """Drag per unstretched length [N/m]: `line_drag` over arrays.

    Args:
        cable: The cable.
        relative_velocity: Velocity of the water relative to the cable [m/s], (..., 3).
        tangent: Unit tangents [-], (..., 3).

    Returns:
        Force per length, (..., 3).
    """
    velocity, direction = np.broadcast_arrays(relative_velocity, tangent)
    factors = (cable.normal_drag_per_length, cable.tangential_drag_per_length)
    force = np.empty(velocity.shape)
    for index in np.ndindex(velocity.shape[:-1]):
        force[index] = line_drag(*velocity[index], *direction[index], *factors)
    return force
