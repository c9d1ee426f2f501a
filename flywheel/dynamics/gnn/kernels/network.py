"""Kernels of the network's pass between its matrix products: activations, the LSTM's cell, messages.

Arrays are (M, K, H): M nodes or edges of K samples, H numbers wide.
"""

from __future__ import annotations

import numpy as np

from flywheel.dynamics.gnn.kernels.compiled import ONE, ZERO, F, Index, compiled


@compiled
def activate(bias: F, driven: F, which: Index, x: F) -> None:
    """Replace x by max(x + bias, 0).

    Args:
      bias: (M, K, H), or (M, 1, H).
      driven: (W, K, H), added by `which`.
      which: (M,) index into `driven`, -1 for none.
      x: (M, K, H).
    """
    count, samples, width = x.shape
    shared = bias.shape[1] == 1
    for m in range(count):
        w = which[m]
        for k in range(samples):
            row, added = x[m, k], bias[m, 0 if shared else k]
            for i in range(width):
                row[i] += added[i]
            if w >= 0:
                more = driven[w, k]
                for i in range(width):
                    row[i] += more[i]
            for i in range(width):
                row[i] = max(row[i], ZERO)


@compiled
def activate_adjoint(x: F, g: F) -> None:
    """Adjoint of `activate`, in place of the gradient `g` of its output `x`."""
    count, samples, width = x.shape
    for m in range(count):
        for k in range(samples):
            for i in range(width):
                g[m, k, i] = g[m, k, i] if x[m, k, i] > 0 else ZERO


@compiled
def remember(gates: F, before: F, cell: F) -> None:
    """Cell state (R, H) of an LSTM.

    Args:
      gates: (R, 4 H) logistic gates: write, keep, show, and (1 + value) / 2.
      before: (R, H) cell state before.
      cell: output.
    """
    rows, width = cell.shape
    for r in range(rows):
        for i in range(width):
            value = gates[r, 3 * width + i]
            cell[r, i] = gates[r, i] * (value + value - ONE) + gates[r, width + i] * before[r, i]


@compiled
def remember_adjoint(
    gates: F, before: F, shown: F, g_hidden: F, g_cell: F, g_gates: F, g_before: F
) -> None:
    """Adjoint of `remember` and of hidden = show * shown, where `shown` is tanh of the cell state.

    `g_gates` and `g_before` are overwritten; the former is that before the logistic function.
    """
    rows, width = before.shape
    for r in range(rows):
        for i in range(width):
            write, keep = gates[r, i], gates[r, width + i]
            show, value = gates[r, 2 * width + i], gates[r, 3 * width + i]
            out, g = shown[r, i], g_hidden[r, i]
            into = g_cell[r, i] + g * show * (ONE - out * out)
            g_gates[r, i] = into * (value + value - ONE) * write * (ONE - write)
            g_gates[r, width + i] = into * before[r, i] * keep * (ONE - keep)
            g_gates[r, 2 * width + i] = g * out * show * (ONE - show)
            g_gates[r, 3 * width + i] = into * (write + write) * value * (ONE - value)
            g_before[r, i] = into * keep


@compiled
def pass_messages(
    starts: Index,
    stops: Index,
    senders: Index,
    node: Index,
    touching: F,
    parts: F,
    column: int,
    edges: F,
    layer: int,
    sums: F,
    place: int,
) -> None:
    """Messages of one relation, and their sums by receiver.

    Args:
      starts, stops: (M,) range of each receiver's edges.
      senders: (E,) their senders.
      node: (E,) possible contact that an edge is, -1 for one that always acts.
      touching: (C, K) 1 where a node touches the surface.
      parts: (M', K, C, H) the nodes' parts: senders' in `column`, receivers' in the next one.
      column: see `parts`.
      edges: (E, K, L, H) the edges' parts in `layer`; become the messages.
      layer: see `edges`.
      sums: (m, K, C, H) sums for the first m receivers, in `place`.
      place: see `sums`.
    """
    samples, width = parts.shape[1], parts.shape[3]
    sums[:, :, place] = ZERO
    for m in range(len(starts)):
        for e in range(starts[m], stops[m]):
            s, n = senders[e], node[e]
            for k in range(samples):
                acts = touching[n, k] if n >= 0 else ONE
                message, sent, received = (
                    edges[e, k, layer],
                    parts[s, k, column],
                    parts[m, k, column + 1],
                )
                for i in range(width):
                    message[i] = max(message[i] + sent[i] + received[i], ZERO)
                if m < len(sums):
                    total = sums[m, k, place]
                    for i in range(width):
                        total[i] += acts * message[i]


@compiled
def pass_messages_adjoint(
    starts: Index,
    stops: Index,
    senders: Index,
    node: Index,
    touching: F,
    g_messages: F,
    column: int,
    edges: F,
    layer: int,
    g_sums: F,
    place: int,
    g_parts: F,
) -> None:
    """Adjoint of `pass_messages`: gradients of the edges' parts replace the messages in `edges`.

    `g_messages` (E, K, H) is the gradient of the messages themselves; of size 0 for none.
    """
    samples, width = g_parts.shape[1], g_parts.shape[3]
    direct, none = len(g_messages) > 0, np.zeros(width, np.float32)
    for m in range(len(starts)):
        summed = m if m < len(g_sums) else 0
        for e in range(starts[m], stops[m]):
            s, n = senders[e], node[e]
            for k in range(samples):
                acts = touching[n, k] if n >= 0 else ONE
                acts = acts if m < len(g_sums) else ZERO
                g, message, more = g_sums[summed, k, place], edges[e, k, layer], none
                if direct:
                    more = g_messages[e, k]
                sent, received = g_parts[s, k, column], g_parts[m, k, column + 1]
                for i in range(width):
                    both = acts * g[i] + more[i]
                    message[i] = both if message[i] > 0 else ZERO
                for i in range(width):
                    sent[i] += message[i]
                for i in range(width):
                    received[i] += message[i]
