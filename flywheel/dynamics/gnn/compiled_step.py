"""A `Step` of compiled kernels, on the processor: the same numbers as `TorchStep`, several times as fast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from flywheel.dynamics.gnn.features import DEPTH, GraphFeatures, MechanicalState, feature_fields
from flywheel.dynamics.gnn.kernels import ends, features, loads, motion
from flywheel.dynamics.gnn.prediction import Prediction
from flywheel.dynamics.gnn.rigid import nearest_rotation
from flywheel.dynamics.gnn.step import Motion, Parts
from flywheel.dynamics.rigid_bodies.ground import Ground


class CompiledStep:
    """In compiled kernels.

    Args:
      parts: of the robot, on the processor.
    """

    def __init__(self, parts: Parts) -> None:
        self.parts, self.config, self.graph = parts, parts.config, parts.graph
        frames, graph = parts.frames, parts.graph
        self.maps = torch.cat([frames.to_nodes, frames.to_arms, frames.to_axes])
        self.exact = parts.config.cable_ends == "attachments"
        self.rolls = self.exact and parts.attachments.rolls
        self.layout, self.ends, self.drives = _layout(parts), _ends(parts), _drives(parts)
        self.loads, self.pairs = _loads(parts), _pairs(parts)
        count, places = len(graph.nodes), graph.anchors.shape[1]
        self.count = count
        self.anchored = np.arange(count, count + places), np.full(places, self.layout.first)
        self.head = frames.bodies + frames.single
        fields = feature_fields(graph.robot, parts.config)["body_node"]
        self.shown = sum(field.width for field in fields)

    def features(
        self,
        state: MechanicalState,
        origin: Tensor,
        controls: Tensor,
        dataset: Tensor,
        ground: Ground,
    ) -> GraphFeatures:
        """See `Step`."""
        given = state.frames, state.velocities, state.winch
        body, cable, contact, pair, anchor, touching, normal = _Features.apply(
            self, *given, state.sides, origin, ground
        )
        nodes, edges = {"body_node": body}, {"cable": cable}
        if len(self.anchored[0]):
            nodes["anchor_node"] = anchor
        if "body" in self.graph.relations:
            edges = {"body": pair, **edges}
        if self.graph.ground >= 0:
            nodes["ground_node"], edges["contact"] = normal, contact
        return GraphFeatures(nodes, edges, controls, touching, dataset)

    def advance(
        self, state: MechanicalState, origin: Tensor, said: Prediction, commands: Tensor
    ) -> tuple[MechanicalState, Motion]:
        """See `Step`."""
        winding = torch.zeros_like(commands) if said.winch is None else said.winch
        winch = _Wind.apply(self.drives, state.winch, commands, winding)
        fitted, velocities, speed = _Advance.apply(
            self, state.frames, state.velocities, said.velocity
        )
        sides = state.sides
        if sides is not None:
            sides = self._follow(fitted[:, -1], sides, origin, winch[-1])
        after = MechanicalState(fitted[:, -1], speed, winch[-1], sides)
        return after, (fitted, velocities, winch)

    @torch.no_grad()
    def _follow(self, frames: Tensor, sides: Tensor, origin: Tensor, winch: Tensor) -> Tensor:
        """The rods' sides after a small motion, as `Attachments.follow` gives them."""
        attachments = self.parts.attachments
        axes, sides = frames[:, attachments.axes].contiguous(), sides.contiguous()
        found = torch.empty_like(axes)
        if not self.rolls:
            ends.upright(axes.numpy(), sides.numpy(), found.numpy())
            return found
        anchors = self.graph.anchors_from(origin, frames.shape[-1])
        along = torch.matmul(attachments.along, torch.cat([frames, anchors], dim=1))
        rest = attachments.rest(winch)
        ends.settle(self.ends, *_arrays(axes, sides, along, rest, found))
        return found


# --- features -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Seen:
    """Intermediate values of one call; arrays as the kernels take them.

    `unit` to `turning` are None unless cables end beside rods.
    """

    vectors: Tensor
    speeds: Tensor
    heading: Tensor
    normal: Tensor
    nodes: Tensor
    end_places: Tensor
    end_speeds: Tensor
    sides: Tensor | None
    axes: Tensor | None
    unit: Tensor | None
    across: Tensor | None
    turning: Tensor | None


class _Features(torch.autograd.Function):
    """Features of body nodes, cable, contact and body edges, and anchors, from a state."""

    @staticmethod
    def forward(
        ctx: Any,
        step: CompiledStep,
        frames: Tensor,
        velocities: Tensor,
        winch: Tensor,
        sides: Tensor | None,
        origin: Tensor,
        ground: Ground,
    ) -> tuple[Tensor, ...]:
        layout, samples = step.layout, frames.shape[-1]
        seen, height, away = _seen(step, frames, velocities, sides, origin, ground)
        vectors, speeds, heading, normal, nodes = _arrays(
            seen.vectors, seen.speeds, seen.heading, seen.normal, seen.nodes
        )
        body = torch.empty(step.shown, step.count, samples)
        touching, gap = torch.empty(seen.normal.shape[1], samples), body[3]
        features.of_nodes(
            layout, vectors, speeds, heading, height.numpy(), normal, *_arrays(body, touching)
        )
        rest = step.graph.rest_lengths(winch)
        loaded = _accelerated(step, frames, seen, rest, body) if step.config.load_features else None
        cable = torch.empty(18 if step.exact else 10, len(rest), samples)
        ended = _arrays(seen.end_places, seen.end_speeds, rest)
        features.of_cables(layout, nodes, *ended, heading, cable.numpy())
        contact = torch.empty(8, len(layout.contacts), samples)
        if away is not None:
            touching[step.count :] = away < layout.near
            gap = torch.cat([gap, away.clamp(max=layout.clamp)])
        features.of_contacts(layout, speeds, heading, normal, *_arrays(gap, contact))
        pair = torch.empty(3, len(step.pairs[0]), samples)
        features.of_pairs(*step.pairs, nodes, heading, pair.numpy())
        anchor = torch.empty(4, len(step.anchored[0]), samples)
        features.of_pairs(*step.anchored, nodes, heading, anchor.numpy())
        anchor[3] = torch.linalg.vector_norm(anchor[:3], dim=0)
        upward = torch.empty(3, 1, samples)
        features.turn(normal, layout.first, heading, upward.numpy(), 0, 0)
        ctx.step, ctx.seen, ctx.loaded, ctx.away = step, seen, loaded, away
        ctx.save_for_backward(body, cable, anchor)
        ctx.mark_non_differentiable(touching, upward)
        return body, cable, contact, pair, anchor, touching, upward

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        step, seen, (body, cable, anchor) = ctx.step, ctx.seen, ctx.saved_tensors
        layout = step.layout
        g_body, g_cable, g_contact, g_pair, g_anchor = (g.contiguous() for g in gradients[:5])
        g_body = g_body.clone()
        g_heading, g_vectors = torch.zeros_like(seen.heading), torch.zeros_like(seen.vectors)
        g_speeds, g_nodes = torch.zeros_like(seen.speeds), torch.zeros_like(seen.nodes)
        g_ends = torch.zeros_like(seen.end_places) if step.exact else g_nodes
        g_end_speeds = torch.zeros_like(seen.end_speeds)
        g_rest = torch.zeros_like(cable[0])
        vectors, speeds, heading, normal, nodes, g_h = _arrays(
            seen.vectors, seen.speeds, seen.heading, seen.normal, seen.nodes, g_heading
        )
        count, g_gap = step.count, torch.zeros_like(seen.normal[0])
        features.of_contacts_adjoint(
            layout, g_contact.numpy(), speeds, heading, normal, *_arrays(g_gap, g_speeds), g_h
        )
        g_body[3] += g_gap[:count]
        if ctx.away is not None:
            moved = seen.normal[:, count:] * g_gap[count:] * (ctx.away < layout.clamp)
            g_vectors[:, :count] += moved.unflatten(1, (-1, count)).sum(1)
        features.of_pairs_adjoint(*step.pairs, g_pair.numpy(), nodes, heading, g_nodes.numpy(), g_h)
        if len(step.anchored[0]):
            g_way = g_anchor[:3] + g_anchor[3] * anchor[:3] / anchor[3]
            features.of_pairs_adjoint(
                *step.anchored, g_way.numpy(), nodes, heading, g_nodes.numpy(), g_h
            )
        ended = _arrays(seen.end_places, seen.end_speeds)
        grown = _arrays(g_nodes, g_ends, g_end_speeds, g_rest)
        features.of_cables_adjoint(
            layout, g_cable.numpy(), nodes, *ended, heading, cable.numpy(), *grown, g_h
        )
        g_frames = torch.zeros(3, step.maps.shape[1], body.shape[-1])
        if ctx.loaded is not None:
            wanted = g_heading, g_frames, g_vectors, g_ends, g_end_speeds, g_rest
            _accelerated_adjoint(step, seen, ctx.loaded, g_body, *wanted)
        _end_gradients(step, seen, g_ends, g_end_speeds, g_frames, g_speeds)
        g_vectors[:, : step.count] += g_nodes[:, : step.count]
        features.of_nodes_adjoint(
            layout, g_body.numpy(), vectors, speeds, heading, normal, body.numpy(),
            *_arrays(g_vectors, g_speeds), g_h,
        )  # fmt: skip
        features.heading_adjoint(layout, vectors, heading, g_h, g_vectors.numpy())
        g_frames += torch.matmul(step.maps.t(), g_vectors)
        winches = len(step.drives.keep)
        g_winch = torch.zeros(winches + 1, body.shape[-1])
        g_winch.index_add_(0, step.graph.cable_winch, step.graph.ratio * g_rest)
        return None, g_frames, g_speeds, g_winch[:winches], None, None, None


def _seen(
    step: CompiledStep,
    frames: Tensor,
    velocities: Tensor,
    sides: Tensor | None,
    origin: Tensor,
    ground: Ground,
) -> tuple[_Seen, Tensor, Tensor | None]:
    """Places and velocities of nodes and ends, (N, K) the height of the ground, and distances ((k - 1) N, K)
    from each node's surface to the nearest boxes [m]; None if those are not seen.
    """
    graph, samples, count = step.graph, frames.shape[-1], step.count
    vectors, speeds = torch.matmul(step.maps, frames), velocities.contiguous()
    heading = torch.empty(2, samples)
    features.heading(step.layout, *_arrays(vectors, heading))
    if graph.robot.grounded:
        height, normal = ground(vectors[:2, :count] + origin[:, None])
    else:
        height, normal = torch.zeros(1, 1), torch.zeros(3, 1, 1)
    normal, away = normal.expand(3, count, samples), None
    if graph.robot.grounded and step.config.surfaces > 1:
        places = torch.cat([vectors[:2, :count] + origin[:, None], vectors[2:, :count]])
        far, beside = ground.nearest(places, step.config.surfaces - 1)
        away = (far - graph.radius).flatten(0, 1)
        normal = torch.cat([normal, beside.flatten(1, 2)], dim=1)
    anchors = graph.anchors_from(origin, samples)
    nodes = torch.cat([vectors[:, :count], anchors], dim=1)
    places, moving = nodes, torch.cat([speeds, torch.zeros_like(anchors)], dim=1)
    axes = unit = across = turning = None
    if step.exact:
        attachments = step.parts.attachments
        places = torch.matmul(attachments.along, torch.cat([frames, anchors], dim=1))
        moving = torch.matmul(attachments.of_nodes, speeds)
    if step.rolls:
        assert sides is not None
        axes, sides = frames[:, attachments.axes].contiguous(), sides.contiguous()
        turning = torch.matmul(attachments.axes_of_nodes, speeds)
        unit, across = torch.empty_like(axes), torch.empty_like(places)
        ends.upright(*_arrays(axes, sides, unit))
        ends.beside(step.ends, *_arrays(axes, unit, across))
        ends.complete(step.ends, *_arrays(axes, turning, across, places, moving))
    seen = _Seen(
        vectors,
        speeds,
        heading,
        normal.contiguous(),
        nodes,
        places,
        moving,
        sides,
        axes,
        unit,
        across,
        turning,
    )
    return seen, height.expand(count, samples).contiguous(), away


@dataclass(frozen=True)
class _Loaded:
    """Intermediate values of the nodes' accelerations; arrays as `loads.accelerate` takes them."""

    centres: Tensor
    axes: Tensor
    rest: Tensor
    torque: Tensor
    turning: Tensor
    out: Tensor


def _accelerated(
    step: CompiledStep, frames: Tensor, seen: _Seen, rest: Tensor, body: Tensor
) -> _Loaded:
    """The nodes' accelerations by cables and gravity; they become the last features (F, N, K) of `body`."""
    numbers, samples = step.parts.builder.loads, frames.shape[-1]
    centres, axes = (torch.matmul(way, frames) for way in (numbers.centres, numbers.axes))
    torque, turning = torch.zeros(2, 3, len(numbers.ease), samples)
    out = torch.empty(3, step.count, samples)
    found = _Loaded(centres, axes, rest[step.parts.attachments.edge], torque, turning, out)
    loads.accelerate(
        step.loads, *_arrays(centres, axes, seen.vectors, seen.end_places),
        *_arrays(seen.end_speeds, found.rest, torque, turning, out),
    )  # fmt: skip
    for n in range(step.count):
        features.turn(out.numpy(), n, seen.heading.numpy(), body.numpy(), step.shown - 3, n)
    return found


def _accelerated_adjoint(
    step: CompiledStep,
    seen: _Seen,
    known: _Loaded,
    g_body: Tensor,
    g_heading: Tensor,
    g_frames: Tensor,
    g_vectors: Tensor,
    g_ends: Tensor,
    g_end_speeds: Tensor,
    g_rest: Tensor,
) -> None:
    """Add the gradients that come by the nodes' accelerations."""
    numbers, g_out = step.parts.builder.loads, torch.zeros_like(known.out)
    heading, g_h = _arrays(seen.heading, g_heading)
    for n in range(step.count):
        features.turn_adjoint(
            g_body.numpy(), step.shown - 3, n, known.out.numpy(), n, heading, g_out.numpy(), g_h
        )
    g_centres, g_axes = torch.zeros_like(known.centres), torch.zeros_like(known.axes)
    g_cables = torch.zeros_like(known.rest)
    given = known.centres, known.axes, seen.vectors, seen.end_places, seen.end_speeds
    grown = g_centres, g_axes, g_vectors, g_ends, g_end_speeds, g_cables
    loads.accelerate_adjoint(
        step.loads, *_arrays(g_out, *given, known.rest, known.torque, known.turning, known.out),
        *_arrays(*grown),
    )  # fmt: skip
    g_rest[step.parts.attachments.edge] += g_cables
    g_frames += torch.matmul(numbers.centres.t(), g_centres)
    g_frames += torch.matmul(numbers.axes.t(), g_axes)


def _end_gradients(
    step: CompiledStep,
    seen: _Seen,
    g_ends: Tensor,
    g_end_speeds: Tensor,
    g_frames: Tensor,
    g_speeds: Tensor,
) -> None:
    """Add the gradients that come by the cables' ends to those of the frames and of the velocities."""
    if not step.exact:
        g_speeds += g_end_speeds[:, : step.count]
        return
    attachments = step.parts.attachments
    if step.rolls:
        assert seen.axes is not None and seen.sides is not None and seen.turning is not None
        assert seen.unit is not None and seen.across is not None
        g_axes, g_unit = torch.zeros_like(seen.axes), torch.zeros_like(seen.axes)
        g_turning = torch.zeros_like(seen.axes)
        known = _arrays(seen.axes, seen.turning, seen.unit, seen.across)
        wanted = _arrays(g_ends, g_end_speeds, g_unit, g_axes, g_turning)
        ends.complete_adjoint(step.ends, *known, *wanted)
        ends.upright_adjoint(*_arrays(seen.axes, seen.sides, seen.unit, g_unit, g_axes))
        g_frames[:, attachments.axes] += g_axes
        g_speeds += torch.matmul(attachments.axes_of_nodes.t(), g_turning)
    g_speeds += torch.matmul(attachments.of_nodes.t(), g_end_speeds)
    g_frames += torch.matmul(attachments.along.t(), g_ends)[:, : g_frames.shape[1]]


# --- integration --------------------------------------------------------------------------------


class _Advance(torch.autograd.Function):
    """Frames and velocities of a chunk, and the nodes' velocities at its end."""

    @staticmethod
    def forward(
        ctx: Any, step: CompiledStep, frames: Tensor, velocities: Tensor, change: Tensor
    ) -> tuple[Tensor, ...]:
        layout, dt, of = step.layout, step.config.dt, step.parts.frames
        velocities, change = velocities.contiguous(), change.contiguous()
        places = torch.matmul(of.to_nodes, frames)
        heading = torch.empty(2, frames.shape[-1])
        features.heading(layout, *_arrays(places, heading))
        fast, free = torch.empty_like(change), torch.empty_like(change)
        given = _arrays(velocities, change, heading)
        motion.integrate(*given, dt, *_arrays(places, fast, free))
        raw = torch.matmul(of.from_nodes, free)
        rigid = raw.clone()
        motion.unit_axes(of.bodies, step.head, rigid.numpy())
        if of.triple:
            rigid[:, :, step.head :] = _rotations(raw[:, :, step.head :], of.triple)
        before = rigid[:, -2] if change.shape[1] > 1 else frames
        speed = torch.matmul(of.to_nodes, (rigid[:, -1] - before) / dt)
        ctx.step, ctx.known = step, (places, heading, change, raw)
        return rigid, fast, speed

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        step, of = ctx.step, ctx.step.parts.frames
        places, heading, change, raw = ctx.known
        g_rigid, g_fast, g_speed = gradients
        g_rigid, g_fast = g_rigid.clone(), g_fast.clone()
        g_frames = torch.zeros(3, *raw.shape[2:])
        g_last = torch.matmul(of.to_nodes.t(), g_speed) / step.config.dt
        g_rigid[:, -1] += g_last
        (g_rigid[:, -2] if change.shape[1] > 1 else g_frames).sub_(g_last)
        if of.triple:
            g_rigid[:, :, step.head :] = _rotations_adjoint(
                raw[:, :, step.head :], of.triple, g_rigid[:, :, step.head :]
            )
        motion.unit_axes_adjoint(of.bodies, step.head, *_arrays(raw, g_rigid))
        g_free = torch.matmul(of.from_nodes.t(), g_rigid)
        g_places, g_heading = torch.zeros_like(places), torch.zeros_like(heading)
        g_speeds, g_change = torch.zeros_like(places), torch.zeros_like(change)
        grown = _arrays(g_fast, g_free, g_speeds, g_change, g_heading, g_places)
        motion.integrate_adjoint(*_arrays(change, heading), step.config.dt, *grown)
        features.heading_adjoint(step.layout, *_arrays(places, heading, g_heading, g_places))
        g_frames += torch.matmul(of.to_nodes.t(), g_places)
        return None, g_frames, g_speeds, g_change


class _Wind(torch.autograd.Function):
    """Winch positions of a chunk."""

    @staticmethod
    def forward(
        ctx: Any, drives: motion.Drives, start: Tensor, commands: Tensor, change: Tensor
    ) -> Tensor:
        start, commands, change = (x.contiguous() for x in (start, commands, change))
        nominal, wound = torch.empty_like(commands), torch.empty_like(commands)
        motion.wind(drives, *_arrays(start, commands, change, nominal, wound))
        ctx.drives, ctx.known = drives, (start, commands, change, nominal)
        return wound

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        start, commands, change, _ = ctx.known
        found = tuple(torch.zeros_like(x) for x in (start, commands, change))
        known = _arrays(*ctx.known, gradients[0].contiguous())
        motion.wind_adjoint(ctx.drives, *known, *_arrays(*found))
        return None, *found


def _rotations(raw: Tensor, count: int) -> Tensor:
    """Vectors (3, n, 3 B, K) of bodies with three, made orthonormal."""
    return nearest_rotation(raw.unflatten(-2, (3, count))).flatten(-3, -2)


@torch.enable_grad()
def _rotations_adjoint(raw: Tensor, count: int, gradient: Tensor) -> Tensor:
    raw = raw.detach().requires_grad_()
    return torch.autograd.grad(_rotations(raw, count), raw, gradient)[0]


# --- constants ----------------------------------------------------------------------------------


def _layout(parts: Parts) -> features.Layout:
    config, graph = parts.config, parts.graph
    length, count = graph.robot.length, len(graph.nodes)
    cable, contact = graph.relations["cable"], graph.relations.get("contact")
    radius = graph.radius[:, 0] if graph.robot.grounded else torch.zeros(count)
    return features.Layout(
        turning=int(graph.turning),
        configured=int(config.config_features),
        exact=int(config.cable_ends == "attachments"),
        vertical=1e-3 * length,
        clamp=config.ground_clamp * length,
        near=config.contact_threshold * length,
        first=int(graph.designated[0]),
        second=int(graph.designated[1]),
        fine=DEPTH * length if config.load_features else 0.0,
        radius=_float(radius),
        senders=cable.senders.numpy(),
        receivers=cable.receivers.numpy(),
        ends=cable.origin.numpy(),
        stiffness=_float(graph.stiffness[:, 0]),
        damping=_float(graph.damping[:, 0]),
        contacts=np.zeros(0, np.int64)
        if contact is None
        else contact.origin.numpy() % graph.contact_count,
        signs=np.zeros(0, np.float32) if contact is None else _float(contact.constants[:, 0]),
    )


def _ends(parts: Parts) -> ends.Ends:
    attachments = parts.attachments
    rods, count = len(attachments.on_rod), len(attachments.rod)
    rod = np.full(count, -1)
    across = np.zeros((count, 2), np.float32)
    for r, here in enumerate(attachments.on_rod):
        rod[here] = r
        across[here] = attachments.across[here][:, [r, rods + r]]
    sizes = [len(here) for here in attachments.on_rod]
    on_rod = [here.numpy() for here in attachments.on_rod]
    return ends.Ends(
        rod=rod,
        across=across,
        starts=np.cumsum([0, *sizes]),
        on_rod=np.concatenate([np.zeros(0, np.int64), *on_rod]),
        stiffness=_float(attachments.stiffness[:, 0]),
        bound=_float(attachments.bound[:, 0]),
    )


def _loads(parts: Parts) -> loads.Loads:
    numbers = parts.builder.loads
    return loads.Loads(
        stiffness=_float(numbers.stiffness[:, 0]),
        damping=_float(numbers.damping[:, 0]),
        driven=numbers.driven[:, 0].long().numpy(),
        of_end=numbers.of_end.numpy(),
        of_axis=numbers.of_axis.numpy(),
        of_node=numbers.of_node.numpy(),
        lightness=_float(numbers.lightness[:, 0]),
        ease=_float(numbers.ease[:, 0]),
        more=_float(numbers.more[:, 0]),
    )


def _drives(parts: Parts) -> motion.Drives:
    winches = parts.winches
    stands = parts.config.winch == "learned"
    keep = torch.ones_like(winches.gain) if winches.keep is None or stands else winches.keep
    gain = torch.zeros_like(winches.gain) if stands else winches.gain
    columns = keep, gain, winches.rest_low, winches.rest_high
    return motion.Drives(*(_float(column[:, 0]) for column in columns))


def _pairs(parts: Parts) -> tuple[Any, Any]:
    body = parts.graph.relations.get("body")
    none = np.zeros(0, np.int64)
    return (none, none) if body is None else (body.senders.numpy(), body.receivers.numpy())


def _float(column: Tensor) -> Any:
    return np.ascontiguousarray(column, np.float32)


def _arrays(*tensors: Tensor) -> tuple[Any, ...]:
    return tuple(tensor.numpy() for tensor in tensors)
