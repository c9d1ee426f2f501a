"""Proof that two ways to write a robot move alike: both are simulated with the same commands."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence

import mujoco
import numpy as np

from flywheel.errors import RobotError
from flywheel.records import Floats
from flywheel.robots.adapt.draft import Certainty, Change, Scale, actuators, at_start
from flywheel.robots.mjcf_reader import MOST_CONTACTS
from flywheel.robots.mujoco_warnings import collected_warnings

SECONDS, HELD = 1.0, 0.1  # of the simulation, and of each command [s]
MOST_STEPS = 2000
PATIENCE = 10.0  # of a clock on the wall, for both [s]
ALIKE = 1e-6  # [m]; what two equal robots may be apart by rounding
UNTURNED = np.eye(3)
PAY, PULL = 0.02, 0.1  # of a cable's length: per second, and in all, that commands move winches


def apart(
    before: mujoco.MjModel,
    after: mujoco.MjModel,
    scales: Mapping[str, Scale],
    turn: Floats = UNTURNED,
) -> float:
    """Largest distance of a body's places in two simulations [m]; infinite if one diverges or lasts.

    Args:
      before: the robot as it was.
      after: the same as it is now; its winches take rest lengths, or their rates.
      scales: of the actuators whose commands differ, by name.
      turn: (3, 3) rotation from the world before to that after.
    """
    rng = np.random.default_rng(0)
    one, other = at_start(before), at_start(after)
    drives = [
        _Drive(before, after, name, a, scales.get(name, Scale(1.0)))
        for a, name in actuators(after)
        if name in {before.actuator(i).name for i in range(before.nu)}
    ]
    for drive in drives:
        drive.begin(one, other)
    steps = int(min(SECONDS / after.opt.timestep, MOST_STEPS))
    every = max(1, int(HELD / after.opt.timestep))
    farthest = 0.0
    mujoco.mj_collision(after, other)
    if other.ncon > MOST_CONTACTS:
        return np.inf
    end = time.monotonic() + PATIENCE
    with collected_warnings() as warnings:
        for step in range(steps):
            if time.monotonic() > end:
                return np.inf
            if step % every == 0:
                for drive in drives:
                    drive.tell(one, other, float(rng.uniform()))
            mujoco.mj_step(before, one)
            mujoco.mj_step(after, other)
            farthest = max(farthest, float(np.abs(one.xpos @ turn.T - other.xpos).max()))
    return np.inf if warnings else farthest


def exact_change(
    before: mujoco.MjModel,
    after: mujoco.MjModel,
    scales: Mapping[str, Scale],
    edits: Sequence[str],
    reason: str,
) -> Change:
    """A change after which a robot moves as it did, with the proof.

    Args:
      before, after, scales: see `apart`.
      edits, reason: see `Change`.

    Raises:
      RobotError: see `refuse_apart`.
    """
    distance = apart(before, after, scales)
    refuse_apart(distance, edits)
    return Change(tuple(edits), reason, certainty_of(distance), evidence_of(distance))


def certainty_of(distance: float) -> Certainty:
    """Equivalent if two robots stay together, else to be confirmed."""
    return Certainty.EQUIVALENT if distance <= ALIKE else Certainty.GUESS


def refuse_apart(distance: float, edits: Iterable[str]) -> None:
    """Refuse changes that are exact, if two robots do not stay together all the same.

    Raises:
      RobotError: there is something in the MJCF that the changes do not know of.
    """
    if np.isfinite(distance) and distance > ALIKE:
        raise RobotError(
            f"The MJCF moves otherwise after what should change nothing ({'; '.join(edits)}): "
            f"{distance:.1g} m apart after {SECONDS:g} s. Write the winches by hand."
        )


def evidence_of(distance: float) -> str:
    """A sentence with the result of `apart`."""
    if not np.isfinite(distance):
        return "It could not be simulated for a proof."
    return f"Both simulated for {SECONDS:g} s with random commands: {distance:.1g} m apart."


class _Drive:
    """One winch in both simulations."""

    def __init__(
        self, before: mujoco.MjModel, after: mujoco.MjModel, name: str, number: int, scale: Scale
    ) -> None:
        self.old, self.new, self.scale = before.actuator(name).id, number, scale
        self.rate = after.actuator_dyntype[number] == mujoco.mjtDyn.mjDYN_INTEGRATOR
        self.old_act = int(before.actuator_actadr[self.old])
        self.new_act = int(after.actuator_actadr[number])
        self.limits = (
            after.actuator_ctrlrange[number]
            if after.actuator_ctrllimited[number]
            else (-np.inf, np.inf)
        )
        self.rest_limits = (
            after.actuator_actrange[number]
            if after.actuator_actlimited[number]
            else (-np.inf, np.inf)
        )
        self.tendon = int(after.actuator_trnid[number, 0])
        self.length = 0.0

    def begin(self, one: mujoco.MjData, other: mujoco.MjData) -> None:
        """Start both with a pull on the cable."""
        self.length = float(other.ten_length[self.tendon])
        rest = float(np.clip(self.length * (1 - PULL / 2), *self.rest_limits))
        if self.new_act >= 0:
            other.act[self.new_act] = rest
        if self.old_act >= 0:
            one.act[self.old_act] = (rest - self.scale.offset) / self.scale.factor

    def tell(self, one: mujoco.MjData, other: mujoco.MjData, share: float) -> None:
        """Give both the same command, at a share of what is tried."""
        if self.rate:
            wanted, offset = self.length * PAY * (2 * share - 1), 0.0
        else:
            wanted, offset = self.length * (1 - PULL * share), self.scale.offset
        command = float(np.clip(wanted, *self.limits))
        other.ctrl[self.new] = command
        one.ctrl[self.old] = (command - offset) / self.scale.factor
