"""Kernels of the network's pass between its matrix products: activations, the LSTM's cell, messages.

Arrays are (M, K, H): M nodes or edges of K samples, H numbers wide.
"""

from __future__ import annotations

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
        for k in range(samples):
            j = 0 if shared else k
            for i in range(width):
                more = driven[which[m], k, i] if which[m] >= 0 else ZERO
                x[m, k, i] = max(x[m, k, i] + bias[m, j, i] + more, ZERO)


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
      node: (E,) body node at whose contact with the ground an edge acts, -1 for one that always acts.
      touching: (N, K) 1 where a node touches the ground.
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
            for k in range(samples):
                acts = touching[node[e], k] if node[e] >= 0 else ONE
                for i in range(width):
                    x = edges[e, k, layer, i] + parts[senders[e], k, column, i]
                    edges[e, k, layer, i] = max(x + parts[m, k, column + 1, i], ZERO)
                if m < len(sums):
                    for i in range(width):
                        sums[m, k, place, i] += acts * edges[e, k, layer, i]


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
    direct = ONE if len(g_messages) else ZERO
    for m in range(len(starts)):
        summed = m if m < len(g_sums) else 0
        for e in range(starts[m], stops[m]):
            also = e if len(g_messages) else 0
            for k in range(samples):
                acts = touching[node[e], k] if node[e] >= 0 else ONE
                acts = acts if m < len(g_sums) else ZERO
                for i in range(width):
                    g = acts * g_sums[summed, k, place, i]
                    if direct > 0:
                        g += g_messages[also, k, i]
                    g = g if edges[e, k, layer, i] > 0 else ZERO
                    edges[e, k, layer, i] = g
                    g_parts[senders[e], k, column, i] += g
                    g_parts[m, k, column + 1, i] += g
