"""Kernels of the network's inputs: features of nodes and edges; see `features.FeatureBuilder`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flywheel.dynamics.gnn.kernels.compiled import ONE, SMALL, ZERO, F, Index, asinh, compiled, norm

_SEEN = np.float32(1.1e-9)  # [m] lengths down to this have a direction


class Layout(NamedTuple):
    """Constants of the features of one robot's graph.

    Attributes:
      turning: 1 if features are in axes that turn with the robot, else 0.
      configured: 1 if nodes show their place in the robot.
      exact: 1 if cables end at attachments, 0 if they end at nodes.
      vertical: horizontal distance of the designated nodes below which a robot has no heading [m].
      clamp, near: largest clearance in the features, and that below which a node touches [m].
      first, second: designated nodes.
      fine: clearance from which its logarithm is shown [m]; 0 if loads are not shown.
      radius: (N,) of the contact sphere at each node [m]; 0 without ground.
      senders, receivers: (E,) nodes of each cable edge.
      ends: (E,) the cable's end at the sender; the other one is its neighbour.
      stiffness, damping: (E,) of each cable edge.
      contacts: (E,) possible contact of each contact edge; of the N body nodes with the ground, then with the
        nearest box, and so on.
      signs: (E,) 1 where the body node receives, else -1.
    """

    turning: int
    configured: int
    exact: int
    vertical: float
    clamp: float
    near: float
    first: int
    second: int
    fine: float
    radius: F
    senders: Index
    receivers: Index
    ends: Index
    stiffness: F
    damping: F
    contacts: Index
    signs: F


@compiled
def difference(a: F, i: int, b: F, j: int, out: F) -> None:
    """Vectors (3, K) from item j of `b` to item i of `a`."""
    for c in range(3):
        for k in range(out.shape[1]):
            out[c, k] = a[c, i, k] - b[c, j, k]


@compiled
def add(g: F, sign: float, g_out: F, m: int) -> None:
    """Adds `sign` times vectors (3, K) to item m."""
    factor = np.float32(sign)
    for c in range(3):
        for k in range(g.shape[1]):
            g_out[c, m, k] += factor * g[c, k]


@compiled
def heading(lay: Layout, nodes: F, h: F) -> None:
    """Cosine and sine `h` (2, K) of the robot's heading."""
    least, i, j = np.float32(lay.vertical), lay.first, lay.second
    for k in range(h.shape[1]):
        x, y = nodes[0, j, k] - nodes[0, i, k], nodes[1, j, k] - nodes[1, i, k]
        size = norm(x, y, ZERO, SMALL)
        turns = lay.turning == 1 and size > least
        h[0, k] = x / size if turns else ONE
        h[1, k] = y / size if turns else ZERO


@compiled
def heading_adjoint(lay: Layout, nodes: F, h: F, g_h: F, g_nodes: F) -> None:
    """Adjoint of `heading`."""
    least, i, j = np.float32(lay.vertical), lay.first, lay.second
    for k in range(h.shape[1]):
        x, y = nodes[0, j, k] - nodes[0, i, k], nodes[1, j, k] - nodes[1, i, k]
        size = norm(x, y, ZERO, SMALL)
        share = ONE / size if lay.turning == 1 and size > least else ZERO
        along = g_h[0, k] * h[0, k] + g_h[1, k] * h[1, k]
        gx, gy = share * (g_h[0, k] - along * h[0, k]), share * (g_h[1, k] - along * h[1, k])
        g_nodes[0, j, k] += gx
        g_nodes[1, j, k] += gy
        g_nodes[0, i, k] -= gx
        g_nodes[1, i, k] -= gy


@compiled
def turn(v: F, i: int, h: F, out: F, c: int, m: int) -> None:
    """Item i of vectors (3, M, K) in turned axes, as features c to c + 2 of item m."""
    for k in range(h.shape[1]):
        cos, sin, x, y = h[0, k], h[1, k], v[0, i, k], v[1, i, k]
        out[c, m, k] = cos * x + sin * y
        out[c + 1, m, k] = cos * y - sin * x
        out[c + 2, m, k] = v[2, i, k]


@compiled
def turn_adjoint(g_out: F, c: int, m: int, v: F, i: int, h: F, g_v: F, g_h: F) -> None:
    """Adjoint of `turn`."""
    for k in range(h.shape[1]):
        cos, sin, x, y = h[0, k], h[1, k], v[0, i, k], v[1, i, k]
        gx, gy = g_out[c, m, k], g_out[c + 1, m, k]
        g_v[0, i, k] += cos * gx - sin * gy
        g_v[1, i, k] += sin * gx + cos * gy
        g_v[2, i, k] += g_out[c + 2, m, k]
        g_h[0, k] += gx * x + gy * y
        g_h[1, k] += gx * y - gy * x


@compiled
def of_nodes(
    lay: Layout, vectors: F, speeds: F, h: F, height: F, normal: F, out: F, touching: F
) -> None:
    """Features (F, N, K) of the body nodes, and which of them touch the ground (N, K).

    Args:
      lay: constants.
      vectors: (3, 3 N, K) places of the nodes, their arms and axes.
      speeds: (3, N, K) velocities of the nodes [m/s].
      h: heading.
      height, normal: (N, K), (3, N, K) of the ground below; a normal of 0 stands for no ground. More normals
        are not used.
      out, touching: outputs.
    """
    count, samples = speeds.shape[1], speeds.shape[2]
    clamp, near = np.float32(lay.clamp), np.float32(lay.near)
    way = np.empty((3, 1, samples), np.float32)
    depth = len(out) - 4  # before the accelerations
    for n in range(count):
        turn(speeds, n, h, out, 0, n)
        for k in range(samples):
            clear = (vectors[2, n, k] - height[n, k]) * normal[2, n, k] - lay.radius[n]
            out[3, n, k] = min(clear, clamp)
            touching[n, k] = ONE if clear < near else ZERO
            if lay.fine > 0:
                out[depth, n, k] = asinh(clear / np.float32(lay.fine))
        if lay.configured == 1:
            difference(vectors, n, vectors, lay.first, way[:, 0])
            turn(way, 0, h, out, 4, n)
            for k in range(samples):
                out[7, n, k] = norm(way[0, 0, k], way[1, 0, k], way[2, 0, k], SMALL)
            turn(vectors, count + n, h, out, 8, n)
            turn(vectors, 2 * count + n, h, out, 11, n)


@compiled
def of_nodes_adjoint(
    lay: Layout,
    g_out: F,
    vectors: F,
    speeds: F,
    h: F,
    normal: F,
    out: F,
    g_vectors: F,
    g_speeds: F,
    g_h: F,
) -> None:
    """Adjoint of `of_nodes`; the ground is a plane near each node."""
    count, samples = speeds.shape[1], speeds.shape[2]
    clamp = np.float32(lay.clamp)
    way, g_way = np.empty((3, 1, samples), np.float32), np.empty((3, 1, samples), np.float32)
    depth = len(out) - 4
    for n in range(count):
        turn_adjoint(g_out, 0, n, speeds, n, h, g_speeds, g_h)
        for k in range(samples):
            seen = g_out[3, n, k] if out[3, n, k] < clamp else ZERO
            if lay.fine > 0:
                seen += g_out[depth, n, k] / (np.float32(lay.fine) * math.cosh(out[depth, n, k]))
            g_vectors[0, n, k] += seen * normal[0, n, k]
            g_vectors[1, n, k] += seen * normal[1, n, k]
            g_vectors[2, n, k] += seen * normal[2, n, k]
        if lay.configured == 1:
            difference(vectors, n, vectors, lay.first, way[:, 0])
            norm_adjoint(g_out, 7, n, out, way, g_way)
            turn_adjoint(g_out, 4, n, way, 0, h, g_way, g_h)
            add(g_way[:, 0], 1.0, g_vectors, n)
            add(g_way[:, 0], -1.0, g_vectors, lay.first)
            turn_adjoint(g_out, 8, n, vectors, count + n, h, g_vectors, g_h)
            turn_adjoint(g_out, 11, n, vectors, 2 * count + n, h, g_vectors, g_h)


@compiled
def norm_adjoint(g_out: F, c: int, m: int, out: F, way: F, g_way: F) -> None:
    """Gradient (3, 1, K) of vectors whose lengths are feature c of item m."""
    for k in range(way.shape[2]):
        size = out[c, m, k]
        share = g_out[c, m, k] / size if size > _SEEN else ZERO
        g_way[0, 0, k] = share * way[0, 0, k]
        g_way[1, 0, k] = share * way[1, 0, k]
        g_way[2, 0, k] = share * way[2, 0, k]


@compiled
def of_cables(lay: Layout, nodes: F, ends: F, end_speeds: F, rest: F, h: F, out: F) -> None:
    """Features (F, E, K) of the cable edges.

    Args:
      lay: constants.
      nodes: (3, N + A, K) places of the nodes and the anchors [m].
      ends, end_speeds: (3, 2 C, K) of the cables' ends, or of the nodes if cables end there.
      rest: (E, K) rest lengths [m].
      h: heading.
      out: output.
    """
    way = np.empty((3, 1, rest.shape[1]), np.float32)
    for e in range(len(lay.senders)):
        a, b = lay.senders[e], lay.receivers[e]
        if lay.exact == 1:
            a, b = lay.ends[e], lay.ends[e] ^ 1
        difference(ends, a, ends, b, way[:, 0])
        turn(way, 0, h, out, 0, e)
        for k in range(rest.shape[1]):
            x, y, z = way[0, 0, k], way[1, 0, k], way[2, 0, k]
            u = end_speeds[0, a, k] - end_speeds[0, b, k]
            v = end_speeds[1, a, k] - end_speeds[1, b, k]
            w = end_speeds[2, a, k] - end_speeds[2, b, k]
            length = norm(x, y, z, SMALL)
            out[3, e, k] = length
            out[4, e, k] = out[0, e, k] / length
            out[5, e, k] = out[1, e, k] / length
            out[6, e, k] = out[2, e, k] / length
            out[7, e, k] = (x * u + y * v + z * w) / length
            out[8, e, k] = rest[e, k]
            out[9, e, k] = length - rest[e, k]
        if lay.exact == 1:
            difference(ends, b, nodes, lay.receivers[e], way[:, 0])
            turn(way, 0, h, out, 10, e)
            difference(ends, a, nodes, lay.senders[e], way[:, 0])
            turn(way, 0, h, out, 13, e)
            for k in range(rest.shape[1]):
                out[16, e, k] = asinh(lay.stiffness[e] * out[9, e, k])
                out[17, e, k] = asinh(lay.damping[e] * out[7, e, k])


@compiled
def of_cables_adjoint(
    lay: Layout,
    g_out: F,
    nodes: F,
    ends: F,
    end_speeds: F,
    h: F,
    out: F,
    g_nodes: F,
    g_ends: F,
    g_end_speeds: F,
    g_rest: F,
    g_h: F,
) -> None:
    """Adjoint of `of_cables`; where cables end at nodes, `g_ends` is `g_nodes`."""
    room = np.empty((4, 3, 1, h.shape[1]), np.float32)
    way, g_way = room[0], room[1]
    for e in range(len(lay.senders)):
        i, j = lay.senders[e], lay.receivers[e]
        a, b = i, j
        if lay.exact == 1:
            a, b = lay.ends[e], lay.ends[e] ^ 1
        _cable_adjoint(
            lay, g_out, e, a, b, ends, end_speeds, h, out, room, g_end_speeds, g_rest, g_h
        )
        add(g_way[:, 0], 1.0, g_ends, a)
        add(g_way[:, 0], -1.0, g_ends, b)
        if lay.exact == 1:
            for end, node, first in ((b, j, 10), (a, i, 13)):
                difference(ends, end, nodes, node, way[:, 0])
                g_way[:] = ZERO
                turn_adjoint(g_out, first, e, way, 0, h, g_way, g_h)
                add(g_way[:, 0], 1.0, g_ends, end)
                add(g_way[:, 0], -1.0, g_nodes, node)


@compiled
def _cable_adjoint(
    lay: Layout,
    g_out: F,
    e: int,
    a: int,
    b: int,
    ends: F,
    end_speeds: F,
    h: F,
    out: F,
    room: F,
    g_end_speeds: F,
    g_rest: F,
    g_h: F,
) -> None:
    """Gradient of the way between a cable's ends, in `room[1]`, and of their speeds and the rest length."""
    way, g_way, unit, g_unit = room[0], room[1], room[2], room[3]
    difference(ends, a, ends, b, way[:, 0])
    for c in range(3):
        for k in range(h.shape[1]):
            unit[c, 0, k] = way[c, 0, k] / out[3, e, k]
    room[1] = ZERO
    room[3] = ZERO
    turn_adjoint(g_out, 0, e, way, 0, h, g_way, g_h)
    turn_adjoint(g_out, 4, e, unit, 0, h, g_unit, g_h)
    stiffness, damping = lay.stiffness[e], lay.damping[e]
    for k in range(h.shape[1]):
        strained, rated = g_out[9, e, k], g_out[7, e, k]
        if lay.exact == 1:
            load, drag = stiffness * out[9, e, k], damping * out[7, e, k]
            strained += g_out[16, e, k] * stiffness / math.sqrt(load * load + ONE)
            rated += g_out[17, e, k] * damping / math.sqrt(drag * drag + ONE)
        g_rest[e, k] += g_out[8, e, k] - strained
        longer, length = g_out[3, e, k] + strained, out[3, e, k]
        ux, uy, uz = unit[0, 0, k], unit[1, 0, k], unit[2, 0, k]
        gx = g_unit[0, 0, k] + rated * (end_speeds[0, a, k] - end_speeds[0, b, k])
        gy = g_unit[1, 0, k] + rated * (end_speeds[1, a, k] - end_speeds[1, b, k])
        gz = g_unit[2, 0, k] + rated * (end_speeds[2, a, k] - end_speeds[2, b, k])
        radial = gx * ux + gy * uy + gz * uz
        g_way[0, 0, k] += (gx - radial * ux) / length + longer * ux
        g_way[1, 0, k] += (gy - radial * uy) / length + longer * uy
        g_way[2, 0, k] += (gz - radial * uz) / length + longer * uz
        unit[0, 0, k], unit[1, 0, k], unit[2, 0, k] = rated * ux, rated * uy, rated * uz
    add(unit[:, 0], 1.0, g_end_speeds, a)
    add(unit[:, 0], -1.0, g_end_speeds, b)


@compiled
def of_pairs(senders: Index, receivers: Index, nodes: F, h: F, out: F) -> None:
    """Vectors from receivers to senders, as features 0 to 2 (3, E, K)."""
    way = np.empty((3, 1, h.shape[1]), np.float32)
    for e in range(len(senders)):
        difference(nodes, senders[e], nodes, receivers[e], way[:, 0])
        turn(way, 0, h, out, 0, e)


@compiled
def of_pairs_adjoint(
    senders: Index, receivers: Index, g_out: F, nodes: F, h: F, g_nodes: F, g_h: F
) -> None:
    """Adjoint of `of_pairs`."""
    way, g_way = np.empty((3, 1, h.shape[1]), np.float32), np.empty((3, 1, h.shape[1]), np.float32)
    for e in range(len(senders)):
        difference(nodes, senders[e], nodes, receivers[e], way[:, 0])
        g_way[:] = ZERO
        turn_adjoint(g_out, 0, e, way, 0, h, g_way, g_h)
        add(g_way[:, 0], 1.0, g_nodes, senders[e])
        add(g_way[:, 0], -1.0, g_nodes, receivers[e])


@compiled
def of_contacts(lay: Layout, speeds: F, h: F, normal: F, gap: F, out: F) -> None:
    """Features (8, E, K) of the contact edges.

    Args:
      lay: constants.
      speeds: (3, N, K) velocities of the nodes [m/s].
      h: heading.
      normal, gap: (3, C, K), (C, K) of the surface of each possible contact, and the clearance from it [m].
      out: output.
    """
    v = np.empty((3, 2, h.shape[1]), np.float32)
    for e in range(len(lay.contacts)):
        c = lay.contacts[e]
        n = c % speeds.shape[1]
        for k in range(h.shape[1]):
            out[0, e, k] = gap[c, k]
            out[7, e, k] = _contact(c, n, lay.signs[e], speeds, normal, v, k)
        turn(v, 0, h, out, 1, e)
        turn(v, 1, h, out, 4, e)


@compiled
def _contact(c: int, n: int, sign: float, speeds: F, normal: F, v: F, k: int) -> float:
    """Speed away from the surface; in `v` the normal and the sliding velocity, towards the receiver."""
    nx, ny, nz = normal[0, c, k], normal[1, c, k], normal[2, c, k]
    speed = speeds[0, n, k] * nx + speeds[1, n, k] * ny + speeds[2, n, k] * nz
    v[0, 0, k], v[1, 0, k], v[2, 0, k] = sign * nx, sign * ny, sign * nz
    v[0, 1, k] = sign * (speeds[0, n, k] - speed * nx)
    v[1, 1, k] = sign * (speeds[1, n, k] - speed * ny)
    v[2, 1, k] = sign * (speeds[2, n, k] - speed * nz)
    return speed


@compiled
def of_contacts_adjoint(
    lay: Layout, g_out: F, speeds: F, h: F, normal: F, g_gap: F, g_speeds: F, g_h: F
) -> None:
    """Adjoint of `of_contacts`; the surfaces' normals are constant."""
    v, g = np.empty((3, 2, h.shape[1]), np.float32), np.empty((3, 2, h.shape[1]), np.float32)
    for e in range(len(lay.contacts)):
        c, sign = lay.contacts[e], lay.signs[e]
        n = c % speeds.shape[1]
        for k in range(h.shape[1]):
            _contact(c, n, sign, speeds, normal, v, k)
        g[:] = ZERO
        turn_adjoint(g_out, 1, e, v, 0, h, g, g_h)
        turn_adjoint(g_out, 4, e, v, 1, h, g, g_h)
        for k in range(h.shape[1]):
            nx, ny, nz = normal[0, c, k], normal[1, c, k], normal[2, c, k]
            into = g_out[7, e, k] - sign * (g[0, 1, k] * nx + g[1, 1, k] * ny + g[2, 1, k] * nz)
            g_gap[c, k] += g_out[0, e, k]
            g_speeds[0, n, k] += sign * g[0, 1, k] + into * nx
            g_speeds[1, n, k] += sign * g[1, 1, k] + into * ny
            g_speeds[2, n, k] += sign * g[2, 1, k] + into * nz
