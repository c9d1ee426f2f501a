"""Kernels of the cables' ends: rods turned by their cables, ends beside the rods' axes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flywheel.dynamics.gnn.kernels.compiled import (
    ONE,
    SMALL,
    SMALL_AXIS,
    ZERO,
    F,
    Index,
    compiled,
    norm,
)

_LARGEST = np.float32(0.5)  # turn of one descent [rad]
_LEAST = np.float32(1e-9)  # steepness that a descent divides by


class Ends(NamedTuple):
    """Constants of the ends of cables; ends 2c and 2c + 1 are those of cable c.

    Attributes:
      rod: (2 C,) rod of each end, -1 for none.
      across: (2 C, 2) its coordinates across the rod [m].
      starts, on_rod: the ends on rod r are on_rod[starts[r] : starts[r + 1]].
      stiffness: (C,) of each cable, as a share of the stiffest.
      bound: (C,) likewise, in the bound on the curvature of the energy.
    """

    rod: Index
    across: F
    starts: Index
    on_rod: Index
    stiffness: F
    bound: F


@compiled
def upright(axes: F, sides: F, out: F) -> None:
    """Sides (3, R, K) of rods, projected to unit vectors across their axes (3, R, K)."""
    for r in range(axes.shape[1]):
        for k in range(axes.shape[2]):
            ax, ay, az = axes[0, r, k], axes[1, r, k], axes[2, r, k]
            sx, sy, sz = sides[0, r, k], sides[1, r, k], sides[2, r, k]
            along = sx * ax + sy * ay + sz * az
            sx, sy, sz = sx - along * ax, sy - along * ay, sz - along * az
            size = norm(sx, sy, sz, SMALL_AXIS)
            out[0, r, k], out[1, r, k], out[2, r, k] = sx / size, sy / size, sz / size


@compiled
def upright_adjoint(axes: F, sides: F, unit: F, g_unit: F, g_axes: F) -> None:
    """Adjoint of `upright`, to the axes alone; `unit` is its output."""
    for r in range(axes.shape[1]):
        for k in range(axes.shape[2]):
            ax, ay, az = axes[0, r, k], axes[1, r, k], axes[2, r, k]
            sx, sy, sz = sides[0, r, k], sides[1, r, k], sides[2, r, k]
            ux, uy, uz = unit[0, r, k], unit[1, r, k], unit[2, r, k]
            gx, gy, gz = g_unit[0, r, k], g_unit[1, r, k], g_unit[2, r, k]
            along = sx * ax + sy * ay + sz * az
            size = norm(sx - along * ax, sy - along * ay, sz - along * az, SMALL_AXIS)
            radial = gx * ux + gy * uy + gz * uz
            gx, gy, gz = (
                (gx - radial * ux) / size,
                (gy - radial * uy) / size,
                (gz - radial * uz) / size,
            )
            into = gx * ax + gy * ay + gz * az
            g_axes[0, r, k] -= along * gx + into * sx
            g_axes[1, r, k] -= along * gy + into * sy
            g_axes[2, r, k] -= along * gz + into * sz


@compiled
def _turned(
    p: float, q: float, ax: float, ay: float, az: float, ux: float, uy: float, uz: float
) -> tuple[float, float, float]:
    """The vector p u + q a x u, across an axis a from the unit vector u across it."""
    x, y, z = ay * uz - az * uy, az * ux - ax * uz, ax * uy - ay * ux
    return p * ux + q * x, p * uy + q * y, p * uz + q * z


@compiled
def beside(ends: Ends, axes: F, unit: F, across: F) -> None:
    """Parts `across` (3, 2 C, K) of the ends' places across their rods [m]; 0 without a rod."""
    for e in range(across.shape[1]):
        r, p, q = ends.rod[e], ends.across[e, 0], ends.across[e, 1]
        if r < 0:
            across[:, e] = ZERO
            continue
        for k in range(across.shape[2]):
            ax, ay, az = axes[0, r, k], axes[1, r, k], axes[2, r, k]
            ux, uy, uz = unit[0, r, k], unit[1, r, k], unit[2, r, k]
            x, y, z = _turned(p, q, ax, ay, az, ux, uy, uz)
            across[0, e, k], across[1, e, k], across[2, e, k] = x, y, z


@compiled
def complete(ends: Ends, axes: F, turning: F, across: F, places: F, speeds: F) -> None:
    """Complete the ends' places [m] and speeds [m/s], (3, 2 C, K), by their parts across the rods.

    Args:
      ends: constants.
      axes, turning: (3, R, K) of the rods, and the rates at which the axes change [1/s].
      across: as `beside` gives it.
      places, speeds: of the points on the axes; completed here.
    """
    for e in range(places.shape[1]):
        r = ends.rod[e]
        if r < 0:
            continue
        for k in range(places.shape[2]):
            qx, qy, qz = across[0, e, k], across[1, e, k], across[2, e, k]
            swing = qx * turning[0, r, k] + qy * turning[1, r, k] + qz * turning[2, r, k]
            places[0, e, k] += qx
            places[1, e, k] += qy
            places[2, e, k] += qz
            speeds[0, e, k] -= swing * axes[0, r, k]
            speeds[1, e, k] -= swing * axes[1, r, k]
            speeds[2, e, k] -= swing * axes[2, r, k]


@compiled
def complete_adjoint(
    ends: Ends,
    axes: F,
    turning: F,
    unit: F,
    across: F,
    g_places: F,
    g_speeds: F,
    g_unit: F,
    g_axes: F,
    g_turning: F,
) -> None:
    """Adjoint of `beside` and `complete`; to places and speeds it is the identity."""
    for e in range(g_places.shape[1]):
        r, p, q = ends.rod[e], ends.across[e, 0], ends.across[e, 1]
        if r < 0:
            continue
        for k in range(g_places.shape[2]):
            ax, ay, az = axes[0, r, k], axes[1, r, k], axes[2, r, k]
            ux, uy, uz = unit[0, r, k], unit[1, r, k], unit[2, r, k]
            tx, ty, tz = turning[0, r, k], turning[1, r, k], turning[2, r, k]
            qx, qy, qz = across[0, e, k], across[1, e, k], across[2, e, k]
            vx, vy, vz = g_speeds[0, e, k], g_speeds[1, e, k], g_speeds[2, e, k]
            along = vx * ax + vy * ay + vz * az
            swing = qx * tx + qy * ty + qz * tz
            gx = g_places[0, e, k] - along * tx
            gy = g_places[1, e, k] - along * ty
            gz = g_places[2, e, k] - along * tz
            g_turning[0, r, k] -= along * qx
            g_turning[1, r, k] -= along * qy
            g_turning[2, r, k] -= along * qz
            g_unit[0, r, k] += p * gx + q * (gy * az - gz * ay)
            g_unit[1, r, k] += p * gy + q * (gz * ax - gx * az)
            g_unit[2, r, k] += p * gz + q * (gx * ay - gy * ax)
            g_axes[0, r, k] += q * (uy * gz - uz * gy) - swing * vx
            g_axes[1, r, k] += q * (uz * gx - ux * gz) - swing * vy
            g_axes[2, r, k] += q * (ux * gy - uy * gx) - swing * vz


@compiled
def settle(ends: Ends, axes: F, sides: F, along: F, rest: F, out: F) -> None:
    """Turn every rod once towards less cable energy, see `Attachments.follow`.

    Args:
      ends: constants.
      axes, sides: (3, R, K) of the rods.
      along: (3, 2 C, K) places of the ends but for their parts across the rods [m].
      rest: (C, K) rest lengths [m].
      out: (3, R, K) sides afterwards.
    """
    _, rods, samples = axes.shape
    unit, across = np.empty_like(axes), np.empty_like(along)
    upright(axes, sides, unit)
    beside(ends, axes, unit, across)
    slope, steepness = np.empty(samples, np.float32), np.empty(samples, np.float32)
    for r in range(rods):
        slope[:] = ZERO
        steepness[:] = ZERO
        for m in range(ends.starts[r], ends.starts[r + 1]):
            _pull(ends, ends.on_rod[m], r, axes, along, across, rest, slope, steepness)
        for k in range(samples):
            angle = -slope[k] / max(steepness[k], _LEAST)
            angle = min(max(angle, -_LARGEST), _LARGEST)
            cos, sin = math.cos(angle), math.sin(angle)
            ax, ay, az = axes[0, r, k], axes[1, r, k], axes[2, r, k]
            ux, uy, uz = unit[0, r, k], unit[1, r, k], unit[2, r, k]
            x, y, z = _turned(cos, sin, ax, ay, az, ux, uy, uz)
            out[0, r, k], out[1, r, k], out[2, r, k] = x, y, z


@compiled
def _pull(
    ends: Ends, e: int, r: int, axes: F, along: F, across: F, rest: F, slope: F, steepness: F
) -> None:
    """Add what the cable at one end does to a rod: slope and curvature of its energy with the roll."""
    other, stiffness, bound = e ^ 1, ends.stiffness[e // 2], ends.bound[e // 2]
    for k in range(len(slope)):
        qx, qy, qz = across[0, e, k], across[1, e, k], across[2, e, k]
        x = along[0, e, k] + qx - along[0, other, k] - across[0, other, k]
        y = along[1, e, k] + qy - along[1, other, k] - across[1, other, k]
        z = along[2, e, k] + qz - along[2, other, k] - across[2, other, k]
        length = norm(x, y, z, SMALL)
        stretch = length - rest[e // 2, k]
        taut = ONE if stretch > 0 else ZERO
        ax, ay, az = axes[0, r, k], axes[1, r, k], axes[2, r, k]
        tx, ty, tz = ay * qz - az * qy, az * qx - ax * qz, ax * qy - ay * qx
        lever = (x * tx + y * ty + z * tz) / length
        bend = (tx * tx + ty * ty + tz * tz - lever * lever - x * qx - y * qy - z * qz) / length
        pull = taut * stiffness * stretch
        slope[k] += pull * lever
        steepness[k] += taut * bound * lever * lever + pull * max(bend, ZERO)
