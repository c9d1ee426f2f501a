"""Kernels of the integration: free nodes, unit vectors of rigid bodies, winches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flywheel.dynamics.gnn.kernels.compiled import SMALL_AXIS, ZERO, F, compiled, norm


@compiled
def integrate(speeds: F, change: F, h: F, dt: float, places: F, fast: F, free: F) -> None:
    """Semi-implicit Euler steps of free nodes through one chunk.

    Args:
      speeds: (3, N, K) at its start [m/s].
      change: (3, n, N, K) velocity changes since then, in turned axes [m/s].
      h: (2, K) cosine and sine of the heading.
      dt: control step [s].
      places: (3, N, K) at its start [m].
      fast, free: (3, n, N, K) outputs: velocities and places after each step.
    """
    step = np.float32(dt)
    _, steps, count, samples = change.shape
    for t in range(steps):
        for n in range(count):
            for k in range(samples):
                cos, sin, x, y = h[0, k], h[1, k], change[0, t, n, k], change[1, t, n, k]
                fast[0, t, n, k] = speeds[0, n, k] + cos * x - sin * y
                fast[1, t, n, k] = speeds[1, n, k] + cos * y + sin * x
                fast[2, t, n, k] = speeds[2, n, k] + change[2, t, n, k]
            for c in range(3):
                for k in range(samples):
                    before = places[c, n, k] if t == 0 else free[c, t - 1, n, k]
                    free[c, t, n, k] = before + step * fast[c, t, n, k]


@compiled
def integrate_adjoint(
    change: F, h: F, dt: float, g_fast: F, g_free: F, g_speeds: F, g_change: F, g_h: F, g_places: F
) -> None:
    """Adjoint of `integrate`; accumulates in `g_fast` and `g_free`."""
    step = np.float32(dt)
    _, steps, count, samples = change.shape
    for t in range(steps - 1, -1, -1):
        for n in range(count):
            for c in range(3):
                for k in range(samples):
                    g_fast[c, t, n, k] += step * g_free[c, t, n, k]
                    g_speeds[c, n, k] += g_fast[c, t, n, k]
                    if t == 0:
                        g_places[c, n, k] += g_free[c, t, n, k]
                    else:
                        g_free[c, t - 1, n, k] += g_free[c, t, n, k]
            for k in range(samples):
                cos, sin, x, y = h[0, k], h[1, k], change[0, t, n, k], change[1, t, n, k]
                gx, gy = g_fast[0, t, n, k], g_fast[1, t, n, k]
                g_change[0, t, n, k] += cos * gx + sin * gy
                g_change[1, t, n, k] += cos * gy - sin * gx
                g_change[2, t, n, k] += g_fast[2, t, n, k]
                g_h[0, k] += gx * x + gy * y
                g_h[1, k] += gy * x - gx * y


@compiled
def unit_axes(first: int, stop: int, frames: F) -> None:
    """Rows `first` to `stop` of frames (3, n, F, K) become unit vectors."""
    for t in range(frames.shape[1]):
        for r in range(first, stop):
            for k in range(frames.shape[3]):
                x, y, z = frames[0, t, r, k], frames[1, t, r, k], frames[2, t, r, k]
                size = norm(x, y, z, SMALL_AXIS)
                frames[0, t, r, k] = x / size
                frames[1, t, r, k] = y / size
                frames[2, t, r, k] = z / size


@compiled
def unit_axes_adjoint(first: int, stop: int, raw: F, g: F) -> None:
    """Adjoint of `unit_axes`, in place of the gradient `g`; `raw` are the frames before."""
    for t in range(raw.shape[1]):
        for r in range(first, stop):
            for k in range(raw.shape[3]):
                x, y, z = raw[0, t, r, k], raw[1, t, r, k], raw[2, t, r, k]
                gx, gy, gz = g[0, t, r, k], g[1, t, r, k], g[2, t, r, k]
                size = norm(x, y, z, SMALL_AXIS)
                radial = (gx * x + gy * y + gz * z) / (size * size)
                g[0, t, r, k] = (gx - radial * x) / size
                g[1, t, r, k] = (gy - radial * y) / size
                g[2, t, r, k] = (gz - radial * z) / size


class Drives(NamedTuple):
    """Constants (W,) of the winches: position' = keep position + gain command, from low to high [m].

    A keep of 1 and a gain of 0 stand for a nominal winch that stands where it is.
    """

    keep: F
    gain: F
    low: F
    high: F


@compiled
def wind(drives: Drives, start: F, commands: F, change: F, nominal: F, out: F) -> None:
    """Winch positions through one chunk.

    Args:
      drives: constants.
      start: (W, K) positions [m].
      commands: (n, W, K).
      change: (n, W, K) added to the nominal positions [m].
      nominal, out: (n, W, K) outputs: positions of the nominal winches, and changed ones [m].
    """
    steps, count, samples = commands.shape
    for w in range(count):
        keep, gain, low, high = drives.keep[w], drives.gain[w], drives.low[w], drives.high[w]
        for t in range(steps):
            for k in range(samples):
                before = start[w, k] if t == 0 else nominal[t - 1, w, k]
                position = keep * before + gain * commands[t, w, k]
                position = position if gain == 0 else min(max(position, low), high)
                nominal[t, w, k] = position
                out[t, w, k] = min(max(position + change[t, w, k], low), high)


@compiled
def wind_adjoint(
    drives: Drives,
    start: F,
    commands: F,
    change: F,
    nominal: F,
    g_out: F,
    g_start: F,
    g_commands: F,
    g_change: F,
) -> None:
    """Adjoint of `wind`."""
    steps, count, samples = commands.shape
    carried = np.empty(samples, np.float32)
    for w in range(count):
        keep, gain, low, high = drives.keep[w], drives.gain[w], drives.low[w], drives.high[w]
        carried[:] = ZERO
        for t in range(steps - 1, -1, -1):
            for k in range(samples):
                wanted = nominal[t, w, k] + change[t, w, k]
                passed = g_out[t, w, k] if low <= wanted <= high else ZERO
                before = start[w, k] if t == 0 else nominal[t - 1, w, k]
                position = keep * before + gain * commands[t, w, k]
                back = carried[k] + passed
                back = back if gain == 0 or low <= position <= high else ZERO
                g_change[t, w, k] += passed
                g_commands[t, w, k] += gain * back
                carried[k] = keep * back
        for k in range(samples):
            g_start[w, k] += carried[k]
