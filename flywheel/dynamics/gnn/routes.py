"""Senders and receivers of messages: static indices for the fused forward pass."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from flywheel.dynamics.gnn.graph import Group, Relation, RobotGraph


class _Gather(torch.autograd.Function):
    """Rows of an array by a fixed index; backward is one product with the incidence matrix."""

    @staticmethod
    def forward(ctx: Any, rows: Tensor, index: Tensor, incidence: Tensor) -> Tensor:
        ctx.save_for_backward(incidence)
        return rows.index_select(0, index)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        (incidence,) = ctx.saved_tensors
        (gradient,) = gradients
        flat = gradient.reshape(len(gradient), -1)
        summed = incidence.to(flat.dtype) @ flat
        return summed.view(-1, *gradient.shape[1:]), None, None


def gather(rows: Tensor, index: Tensor, incidence: Tensor) -> Tensor:
    """Rows (M, ...) by `index` (E,); `incidence` (M, E) is 1 where an index is that row."""
    if torch.is_grad_enabled():
        taken: Tensor = _Gather.apply(rows, index, incidence)
        return taken
    return rows.index_select(0, index)


class _Senders:
    """Takes the senders' rows for the edges of one group: (M, K, C) -> (R, d, K, C).

    Rows come by family: those of the body nodes, and those of anchors and ground.
    """

    def __init__(self, relation: Relation, group: Group, graph: RobotGraph) -> None:
        index = relation.senders[group.edges]
        listed = index.tolist()
        self._shape = (len(group.receivers), group.degree)
        families = {int(i >= graph.body_count) for i in listed}
        self._family = families.pop() if len(families) == 1 else None
        start, stop = graph.families[self._family or 0]
        stop = graph.count if self._family is None else stop
        listed = [i - start for i in listed]
        self._index = index - start
        self._broadcast = stop - start == 1 and group.degree == 1
        self._all = listed == list(range(stop - start))
        self._incidence = torch.zeros(stop - start, len(listed), device=graph.device)
        self._incidence[self._index, torch.arange(len(listed))] = 1.0

    def __call__(self, families: list[Tensor]) -> Tensor:
        rows = torch.cat(families) if self._family is None else families[self._family]
        if self._broadcast:
            return rows.unsqueeze(1)
        taken = rows if self._all else gather(rows, self._index, self._incidence)
        return taken.unflatten(0, self._shape)


class Route:
    """Senders and receivers of the messages of one group of edges.

    Attributes:
      name: of the relation.
      place: of the relation among all, in the order of the packed weights.
      part: index of the group in the relation.
      family: 0 if the receivers are body nodes, 1 if they are anchors or the ground.
      whole: the receivers are all nodes of their family, in order.
      within_family: (R,) the receivers' numbers in their family.
    """

    def __init__(self, relation: Relation, group: Group, part: int, graph: RobotGraph) -> None:
        self.name, self.degree, self.part = relation.name, group.degree, part
        self.place = list(graph.relations).index(relation.name)
        self.senders = _Senders(relation, group, graph)
        self.family = int(group.receivers[0] >= graph.body_count)
        start, stop = graph.families[self.family]
        self.whole = group.receivers == tuple(range(start, stop))
        self.within_family = torch.tensor(group.receivers, device=graph.device) - start
        self._incidence = torch.zeros(stop - start, len(group.receivers), device=graph.device)
        self._incidence[self.within_family, torch.arange(len(group.receivers))] = 1.0

    def receivers(self, families: list[Tensor]) -> Tensor:
        """(R, 1, K, C) the receivers' rows."""
        rows = families[self.family]
        if not self.whole:
            rows = gather(rows, self.within_family, self._incidence)
        return rows.unsqueeze(1)


def all_routes(graph: RobotGraph) -> tuple[Route, ...]:
    """One route per group of edges, relation by relation."""
    return tuple(
        Route(relation, group, part, graph)
        for relation in graph.relations.values()
        for part, group in enumerate(relation.groups)
    )
