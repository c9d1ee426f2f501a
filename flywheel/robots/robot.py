"""The robot in the form used by all packages: its parts, and the motion of its winches.

Every number comes from one MJCF, by `read_robot`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flywheel.errors import RobotError
from flywheel.records import Episode, Floats, State
from flywheel.robots.parts import Attachment, Body, Cable, TrackedPoint, Winch
from flywheel.rotations import rotate

ROUNDED = 1e-6  # relative: a step given with six digits is the one that is meant


@dataclass(frozen=True)
class Robot:
    """A cable-driven robot, read from its MJCF.

    Attributes:
      name: the MJCF's model name.
      xml: the whole MJCF, self-contained.
      digest: sha256 of the canonical MJCF; two robots with one digest are the same robot.
      bodies, points, cables, winches: in the MJCF's order.
      keyframe: (unbatched) state of the MJCF's first keyframe, the state after every reset.
      timestep: MuJoCo's step [s]. A plant takes this one and the integrator, whatever `xml` has.
      integrator: MuJoCo's, by its name in the MJCF.
      length: characteristic length L, for errors and noise: the longest distance between two
        tracked points of one body [m].
      grounded: the MJCF has a plane that takes part in contacts.
      free: every body moves on its own free joint, so that its points determine its pose.
    """

    name: str
    xml: str
    digest: str
    bodies: tuple[Body, ...]
    points: tuple[TrackedPoint, ...]
    cables: tuple[Cable, ...]
    winches: tuple[Winch, ...]
    keyframe: State
    timestep: float
    integrator: str
    length: float
    grounded: bool
    free: bool

    @cached_property
    def tethered(self) -> bool:
        """True if a cable ends on something immovable."""
        return any(end.body < 0 for cable in self.cables for end in cable.ends)

    @cached_property
    def span(self) -> float:
        """Longest distance between two fixed ends of cables [m]; 0 if there are fewer than two."""
        fixed = np.array([end.offset for c in self.cables for end in c.ends if end.body < 0])
        if len(fixed) < 2:
            return 0.0
        return float(np.linalg.norm(fixed[:, None] - fixed, axis=-1).max())

    def offsets_of(self, body: Body) -> Floats:
        """(n, 3) places of a body's n tracked points in its frame [m]."""
        return np.array([self.points[i].offset for i in body.points])

    def cable_lengths(self, poses: Floats) -> Floats:
        """(B, C) lengths of the cables between bodies at poses (B, bodies, 7) [m]."""
        ends = [[_place(poses, end) for end in cable.ends] for cable in self.cables]
        return np.stack([np.linalg.norm(a - b, axis=-1) for a, b in ends], axis=1)

    def com_weights(self, body: Body) -> Floats:
        """(n,) weights with sum 1 of a body's tracked points, whose combination is nearest its CoM."""
        offsets = self.offsets_of(body)
        middle = offsets.mean(axis=0)
        extra = np.linalg.pinv((offsets - middle).T, rcond=1e-9) @ (body.com - middle)
        return 1.0 / len(offsets) + extra - extra.mean()

    @cached_property
    def center_weights(self) -> Floats:
        """(P,) weights with sum 1 whose combination of the tracked points is the centre of mass.

        Exact if each body's centre of mass lies in the span of its points (a rod with a cap at each
        end); else the nearest such combination. Bodies without points do not count.
        """
        weights = np.zeros(len(self.points))
        for body in self.bodies:
            if body.points:
                weights[list(body.points)] += body.mass * self.com_weights(body)
        return weights / weights.sum()

    def require_free(self, to_be: str) -> None:
        """Raise a `RobotError` for a robot with joints, which cannot be, e.g., "dropped"."""
        why = "it has joints, and that needs bodies that are all free (a <freejoint/> each)"
        self._require(self.free, to_be, why)

    def require_winches(self, to_be: str) -> None:
        """Raise a `RobotError` for a robot without winches, which cannot be, e.g., "driven"."""
        why = "it has no winch, and nothing moves it but its start. compare and diagnose need none"
        self._require(bool(self.winches), to_be, why)

    def require_rest_lengths(self, to_be: str) -> None:
        """Raise a `RobotError` for winches that take tensions."""
        why = "its winches take tensions, and that needs winches that take rest lengths or their rates"
        self._require(not self.tension_driven, to_be, why)

    def require_even_winches(self, to_be: str) -> None:
        """Raise a `RobotError` for winches that take tensions, or move cables by different amounts."""
        why = (
            "it has antagonists on one winch, and that needs winches whose cables all change by the same "
            "amount"
        )
        self._require(all(winch.alike for winch in self.winches), to_be, why)
        self.require_rest_lengths(to_be)

    def _require(self, able: bool, to_be: str, why: str) -> None:
        if not able:
            raise RobotError(f"{self.name} cannot be {to_be}: {why}.")

    @cached_property
    def ratios(self) -> Floats:
        """(C,) change of each cable's rest length per change of its winch's position; 0 without a winch."""
        ratios = np.zeros(len(self.cables))
        for winch in self.winches:
            ratios[list(winch.cables)] = winch.ratios
        return ratios

    @cached_property
    def tension_driven(self) -> bool:
        """True if its winches take tensions; then all of them do."""
        return any(winch.kind == "tension" for winch in self.winches)

    def told_tensions(self, winch: Floats) -> Floats:
        """Tensions (..., C) [N] of cables by winches at (..., W); 0 for cables with a rest length."""
        found = np.zeros((*winch.shape[:-1], len(self.cables)))
        if self.tension_driven:
            driven_by = np.array([cable.winch for cable in self.cables])
            found[..., driven_by >= 0] = winch[..., driven_by[driven_by >= 0]]
        return found

    def control_steps(self, near: float) -> tuple[float, ...]:
        """Possible control steps [s] around a given one, the nearest first.

        They are the multiples of MuJoCo's step; the given one alone if it is one.
        """
        if not 0.0 < near < math.inf:
            return (self.timestep,)
        count = near / self.timestep
        if round(count) >= 1 and math.isclose(round(count) * self.timestep, near, rel_tol=ROUNDED):
            return (near,)
        around = (n * self.timestep for n in (math.floor(count), math.ceil(count)) if n)
        return tuple(sorted(around, key=lambda step: abs(step - near)))

    def stepped(self, dt: float) -> Robot:
        """The robot with the longest step of MuJoCo that is not longer than its own and divides dt [s].

        Itself if its own does.
        """
        if self.control_steps(dt) == (dt,):
            return self
        return replace(self, timestep=dt / math.ceil(dt / self.timestep))

    @cached_property
    def control_low(self) -> Floats:
        """(W,) lowest command of each winch."""
        return np.array([w.control_range[0] for w in self.winches])

    @cached_property
    def control_high(self) -> Floats:
        """(W,) highest command of each winch."""
        return np.array([w.control_range[1] for w in self.winches])

    @cached_property
    def rest_low(self) -> Floats:
        """(W,) shortest rest length each winch can reach [m]."""
        return np.array([w.rest_range[0] for w in self.winches])

    @cached_property
    def rest_high(self) -> Floats:
        """(W,) longest rest length each winch can reach [m]."""
        return np.array([w.rest_range[1] for w in self.winches])

    @cached_property
    def rate_driven(self) -> np.ndarray:
        """(W,) bool: True for rate winches; the others are position winches."""
        return np.array([w.kind == "rate" for w in self.winches], bool)

    def holding(self, winch: Floats) -> Floats:
        """The command (..., W) that holds the winches at the positions `winch` (..., W) [m]."""
        return np.where(self.rate_driven, 0.0, winch)

    def winch_of(self, state: State) -> Floats:
        """Winch positions (..., W) of a plant's state [m]."""
        return state.act[..., [w.activation for w in self.winches]]

    def points_of(self, state: State) -> Floats:
        """Tracked points (..., P, 3) of a plant's state [m]; of a robot of free bodies."""
        poses = state.qpos.reshape(*state.qpos.shape[:-1], len(self.bodies), 7)
        places = [
            poses[..., p.body, :3] + rotate(poses[..., p.body, 3:], p.offset) for p in self.points
        ]
        return np.stack(places, axis=-2)

    def known_winch(self, observed: Floats, controls: Floats, dt: float) -> Floats:
        """Best estimate of the winch positions (..., T + 1, W) [m] over an episode.

        Measured ones if available; in between dead-reckoned from the commands, starting at the last
        measured position. Before the first one, and without any, from the keyframe's, or from the first
        commands of winches that take tensions.

        Args:
          observed: (..., T + 1, W) measured positions, NaN if not measured [m].
          controls: (..., T, W) commands.
          dt: control step [s].
        """
        if np.isfinite(observed).all():
            return np.asarray(observed)
        start = self.first_winch(observed[..., 0, :], controls[..., :1, :])
        return self.dead_reckon(start, controls, dt, observed)

    def first_winch(self, observed: Floats, controls: Floats) -> Floats:
        """Best estimate of the winch positions (..., W) at the beginning of an episode.

        Args:
          observed: (..., W) measured positions, NaN if not measured.
          controls: (..., 1, W) first commands; (..., 0, W) if there are none.
        """
        unknown = self.winch_of(self.keyframe)
        if self.tension_driven and controls.shape[-2]:  # it has been told so for long
            unknown = np.clip(controls[..., 0, :], self.control_low, self.control_high)
        return np.where(np.isfinite(observed), observed, unknown)

    def winches_of(self, episode: Episode) -> Floats:
        """(T + 1, W) best estimate of an episode's winch positions [m], see `known_winch`."""
        track = episode.trajectory
        return self.known_winch(track.observations.winch, track.controls, track.dt)

    def wound(self, now: Floats, told: Floats, dt: float) -> Floats:
        """Positions (..., W) [m] of nominal winches at (..., W), `dt` [s] after commands (..., W)."""
        return np.clip(now + self.rates(now, told, dt) * dt, self.rest_low, self.rest_high)

    def rates(self, now: Floats, told: Floats, dt: float, faster: Floats | float = 1.0) -> Floats:
        """Mean rates (..., W) [m/s] of winches at (..., W) over the `dt` [s] after commands (..., W).

        Args:
          faster: (..., W) ratio of their speed to that of nominal winches.
        """
        if self._all_rates:
            return np.asarray(told * faster)
        share = -np.expm1(-dt * faster / np.maximum(self._lags, 1e-9))
        return np.where(self.rate_driven, told * faster, share * (told - now) / dt)

    def telling(self, now: Floats, rates: Floats, dt: float) -> Floats:
        """Commands (..., W) for nominal winches at (..., W) that give mean rates (..., W) over `dt` [s]."""
        if self._all_rates:
            return rates
        share = -np.expm1(-dt / np.maximum(self._lags, 1e-9))
        return np.where(self.rate_driven, rates, now + rates * dt / share)

    @cached_property
    def _all_rates(self) -> bool:
        """True without position winches; cached, because it is needed at every step."""
        return bool(self.rate_driven.all())

    @cached_property
    def _lags(self) -> Floats:
        """(W,) time constants of position winches; 0 for the others [s]."""
        return np.array([winch.time_constant for winch in self.winches])

    def dead_reckon(
        self, start: Floats, controls: Floats, dt: float, measured: Floats | None = None
    ) -> Floats:
        """Positions of nominal winches under `controls`.

        Args:
          start: (..., W) positions before the first control [m].
          controls: (..., T, W) commands.
          dt: control step [s].
          measured: (..., T + 1, W) positions to use and to continue from; NaN if missing [m].

        Returns:
          (..., T + 1, W) positions [m], clamped at the ends of the winches' ranges at every step.
        """
        told = np.clip(controls, self.control_low, self.control_high)
        return self.wind(start, told, dt, measured)

    def wind(
        self,
        start: Floats,
        told: Floats,
        dt: float,
        measured: Floats | None = None,
        loaded: Callable[[int, Floats, Floats], Floats] | None = None,
    ) -> Floats:
        """Winch positions step by step, from the winches' commands; the loop of all dead reckoning.

        Args:
          start: (..., W) positions before the first step [m].
          told: (..., T, W) commands of nominal winches; not clipped.
          dt: control step [s].
          measured: (..., T + 1, W) positions to use and to continue from; NaN if missing [m].
          loaded: maps a step, the positions and its commands, both (..., W), to commands with which
            nominal winches would move as the loaded ones do.

        Returns:
          (..., T + 1, W) positions [m], clamped at the ends of the winches' ranges at every step.
        """
        positions = [np.asarray(start)]
        for step in range(told.shape[-2]):
            now, command = positions[-1], told[..., step, :]
            if loaded is not None:
                command = loaded(step, now, command)
            after = self.wound(now, command, dt)
            if measured is not None:
                known = measured[..., step + 1, :]
                after = np.where(np.isfinite(known), known, after)
            positions.append(after)
        return np.stack(positions, axis=-2)


def _place(poses: Floats, end: Attachment) -> Floats:
    """(B, 3) of a cable's end [m]."""
    if end.body < 0:
        return np.broadcast_to(end.offset, (len(poses), 3))
    pose = poses[:, end.body]
    return np.asarray(pose[:, :3] + rotate(pose[:, 3:], end.offset))
