"""Kernels of the nodes' accelerations by cables and gravity; see `loads.CableLoads`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flywheel.dynamics.gnn.kernels.compiled import ONE, SMALL, ZERO, F, Index, asinh, compiled, norm


class Loads(NamedTuple):
    """Constants of the loads of one robot, as in `CableLoads`.

    Attributes:
      stiffness, damping: (C,) of each cable.
      driven: (C,) 1 if it has a winch, else 0.
      of_end, of_axis, of_node: (2 C,), (Q,), (N,) bodies; -1 for the world.
      lightness, ease: (B,) of each body.
      more: (Q,) of each axis.
    """

    stiffness: F
    damping: F
    driven: Index
    of_end: Index
    of_axis: Index
    of_node: Index
    lightness: F
    ease: F
    more: F


@compiled
def _tension(load: float, drag: float, driven: int) -> float:
    if driven == 0:
        return drag + load if load > 0.0 else drag
    return drag + load if drag + load > 0.0 else 0.0


@compiled
def accelerate(
    loads: Loads,
    centres: F,
    axes: F,
    vectors: F,
    ends: F,
    speeds: F,
    rest: F,
    torque: F,
    turning: F,
    out: F,
) -> None:
    """Asinh of the nodes' accelerations (3, N, K), which `CableLoads.accelerations` gives [g].

    Args:
      loads: constants.
      centres, axes: (3, B, K), (3, Q, K) of the bodies.
      vectors: (3, 3 N, K) of which the second N are from the centres to the nodes.
      ends, speeds: (3, 2 C, K) of the cables.
      rest: (C, K) rest lengths.
      torque, turning: (3, B, K) of the bodies; outputs, which begin with zeros.
      out: output.
    """
    force = np.zeros(torque.shape, np.float32)
    _pull(loads, centres, ends, speeds, rest, force, torque)
    for b in range(len(loads.ease)):
        for k in range(rest.shape[1]):
            for i in range(3):
                turning[i, b, k] = loads.ease[b] * torque[i, b, k]
    for q in range(len(loads.more)):
        b = loads.of_axis[q]
        for k in range(rest.shape[1]):
            about = loads.more[q] * _dot(axes, q, torque, b, k)
            for i in range(3):
                turning[i, b, k] += about * axes[i, q, k]
    count = len(loads.of_node)
    for n in range(count):
        b, arm = loads.of_node[n], count + n
        light = loads.lightness[b]
        for k in range(rest.shape[1]):
            rx, ry, rz = vectors[0, arm, k], vectors[1, arm, k], vectors[2, arm, k]
            tx, ty, tz = turning[0, b, k], turning[1, b, k], turning[2, b, k]
            out[0, n, k] = asinh(light * force[0, b, k] + ty * rz - tz * ry)
            out[1, n, k] = asinh(light * force[1, b, k] + tz * rx - tx * rz)
            out[2, n, k] = asinh(light * force[2, b, k] - ONE + tx * ry - ty * rx)


@compiled
def _pull(loads: Loads, centres: F, ends: F, speeds: F, rest: F, force: F, torque: F) -> None:
    """Adds the cables' forces and torques on the bodies (3, B, K)."""
    for c in range(len(rest)):
        for k in range(rest.shape[1]):
            x, y, z = _between(ends, c, k)
            u, v, w = _between(speeds, c, k)
            length = norm(x, y, z, SMALL)
            load = loads.stiffness[c] * (length - rest[c, k])
            drag = loads.damping[c] * (x * u + y * v + z * w) / length
            pull = _tension(load, drag, loads.driven[c]) / length
            for end in range(2 * c, 2 * c + 2):
                b = loads.of_end[end]
                if b >= 0:
                    share = pull if end == 2 * c else -pull
                    fx, fy, fz = share * x, share * y, share * z
                    force[0, b, k] += fx
                    force[1, b, k] += fy
                    force[2, b, k] += fz
                    lx, ly, lz = _lever(ends, end, centres, b, k)
                    torque[0, b, k] += ly * fz - lz * fy
                    torque[1, b, k] += lz * fx - lx * fz
                    torque[2, b, k] += lx * fy - ly * fx


@compiled
def accelerate_adjoint(
    loads: Loads,
    g_out: F,
    centres: F,
    axes: F,
    vectors: F,
    ends: F,
    speeds: F,
    rest: F,
    torque: F,
    turning: F,
    out: F,
    g_centres: F,
    g_axes: F,
    g_vectors: F,
    g_ends: F,
    g_speeds: F,
    g_rest: F,
) -> None:
    """Adjoint of `accelerate`."""
    g_force, g_turning = np.zeros(torque.shape, np.float32), np.zeros(torque.shape, np.float32)
    g_torque = np.zeros(torque.shape, np.float32)
    count = len(loads.of_node)
    for n in range(count):
        b, arm = loads.of_node[n], count + n
        light = loads.lightness[b]
        for k in range(rest.shape[1]):
            gx = g_out[0, n, k] / math.cosh(out[0, n, k])
            gy = g_out[1, n, k] / math.cosh(out[1, n, k])
            gz = g_out[2, n, k] / math.cosh(out[2, n, k])
            g_force[0, b, k] += light * gx
            g_force[1, b, k] += light * gy
            g_force[2, b, k] += light * gz
            rx, ry, rz = vectors[0, arm, k], vectors[1, arm, k], vectors[2, arm, k]
            tx, ty, tz = turning[0, b, k], turning[1, b, k], turning[2, b, k]
            g_turning[0, b, k] += ry * gz - rz * gy
            g_turning[1, b, k] += rz * gx - rx * gz
            g_turning[2, b, k] += rx * gy - ry * gx
            g_vectors[0, arm, k] += gy * tz - gz * ty
            g_vectors[1, arm, k] += gz * tx - gx * tz
            g_vectors[2, arm, k] += gx * ty - gy * tx
    for b in range(len(loads.ease)):
        for k in range(rest.shape[1]):
            for i in range(3):
                g_torque[i, b, k] = loads.ease[b] * g_turning[i, b, k]
    for q in range(len(loads.more)):
        b = loads.of_axis[q]
        for k in range(rest.shape[1]):
            about = loads.more[q] * _dot(axes, q, torque, b, k)
            g_about = loads.more[q] * _dot(axes, q, g_turning, b, k)
            for i in range(3):
                g_axes[i, q, k] += about * g_turning[i, b, k] + g_about * torque[i, b, k]
                g_torque[i, b, k] += g_about * axes[i, q, k]
    _cables_adjoint(
        loads, centres, ends, speeds, rest, g_force, g_torque, g_centres, g_ends, g_speeds, g_rest
    )


@compiled
def _cables_adjoint(
    loads: Loads,
    centres: F,
    ends: F,
    speeds: F,
    rest: F,
    g_force: F,
    g_torque: F,
    g_centres: F,
    g_ends: F,
    g_speeds: F,
    g_rest: F,
) -> None:
    """Gradients of the cables, from those of the bodies' forces and torques (3, B, K)."""
    for c in range(len(rest)):
        stiffness, damping = loads.stiffness[c], loads.damping[c]
        for k in range(rest.shape[1]):
            x, y, z = _between(ends, c, k)
            u, v, w = _between(speeds, c, k)
            length = norm(x, y, z, SMALL)
            x, y, z = x / length, y / length, z / length
            rate = x * u + y * v + z * w
            load, drag = stiffness * (length - rest[c, k]), damping * rate
            pull = _tension(load, drag, loads.driven[c])
            gx, gy, gz = ZERO, ZERO, ZERO  # of the force on the first end
            for end in range(2 * c, 2 * c + 2):
                b = loads.of_end[end]
                if b >= 0:
                    sign = ONE if end == 2 * c else -ONE
                    lx, ly, lz = _lever(ends, end, centres, b, k)
                    tx, ty, tz = g_torque[0, b, k], g_torque[1, b, k], g_torque[2, b, k]
                    gx += sign * (g_force[0, b, k] + ty * lz - tz * ly)
                    gy += sign * (g_force[1, b, k] + tz * lx - tx * lz)
                    gz += sign * (g_force[2, b, k] + tx * ly - ty * lx)
                    share = sign * pull
                    hx, hy = share * (y * tz - z * ty), share * (z * tx - x * tz)
                    hz = share * (x * ty - y * tx)
                    g_ends[0, end, k] += hx
                    g_ends[1, end, k] += hy
                    g_ends[2, end, k] += hz
                    g_centres[0, b, k] -= hx
                    g_centres[1, b, k] -= hy
                    g_centres[2, b, k] -= hz
            g_pull = x * gx + y * gy + z * gz
            if loads.driven[c] == 1:
                acts = ONE if load + drag > ZERO else ZERO
                g_load, g_rate = acts * stiffness * g_pull, acts * damping * g_pull
            else:
                g_load, g_rate = (stiffness * g_pull if load > ZERO else ZERO), damping * g_pull
            g_rest[c, k] -= g_load
            gx, gy, gz = pull * gx + g_rate * u, pull * gy + g_rate * v, pull * gz + g_rate * w
            along = x * gx + y * gy + z * gz
            gx = (gx - along * x) / length + g_load * x
            gy = (gy - along * y) / length + g_load * y
            gz = (gz - along * z) / length + g_load * z
            _apart(g_ends, c, k, gx, gy, gz)
            _apart(g_speeds, c, k, g_rate * x, g_rate * y, g_rate * z)


@compiled
def _between(a: F, c: int, k: int) -> tuple[float, float, float]:
    """From a cable's first end to its second."""
    i, j = 2 * c, 2 * c + 1
    return a[0, j, k] - a[0, i, k], a[1, j, k] - a[1, i, k], a[2, j, k] - a[2, i, k]


@compiled
def _apart(g: F, c: int, k: int, x: float, y: float, z: float) -> None:
    """Adjoint of `_between`."""
    i, j = 2 * c, 2 * c + 1
    g[0, j, k] += x
    g[1, j, k] += y
    g[2, j, k] += z
    g[0, i, k] -= x
    g[1, i, k] -= y
    g[2, i, k] -= z


@compiled
def _lever(ends: F, end: int, centres: F, b: int, k: int) -> tuple[float, float, float]:
    """From a body's centre of mass to a cable's end on it."""
    return (
        ends[0, end, k] - centres[0, b, k],
        ends[1, end, k] - centres[1, b, k],
        ends[2, end, k] - centres[2, b, k],
    )


@compiled
def _dot(a: F, i: int, b: F, j: int, k: int) -> float:
    return a[0, i, k] * b[0, j, k] + a[1, i, k] * b[1, j, k] + a[2, i, k] * b[2, j, k]
