"""Cables: the MJCF's tendons, each between two sites."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np

from flywheel.errors import RobotError
from flywheel.records import Floats
from flywheel.robots.bodies import body_index, in_body_frame
from flywheel.robots.parts import Attachment, Body, Cable, TrackedPoint, Winch
from flywheel.robots.problems import Problems
from flywheel.robots.winches import is_passive


def read_cables(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    bodies: tuple[Body, ...],
    points: tuple[TrackedPoint, ...],
    winches: tuple[Winch, ...],
    act: Floats,
) -> tuple[Cable, ...]:
    """The cables, in the order of the MJCF's tendons.

    Args:
      data: with kinematics computed at the keyframe.
      act: (na,) the keyframe's activations.

    Raises:
      RobotError: tendons that are no straight line between two sites, that end on no moving body, that
        could push, or that nothing pulls.
    """
    actuators = {
        cable: (index, actuator)
        for index, winch in enumerate(winches)
        for cable, actuator in zip(winch.cables, winch.actuators, strict=True)
    }
    problems, cables, tendons = Problems(), [], _Tendons(model, data, bodies, points)
    for tendon in range(model.ntendon):
        read = partial(tendons.passive, tendon)
        if tendon in actuators:
            read = partial(tendons.winched, tendon, *actuators[tendon], act)
        cables.append(problems.attempt(read))
    problems.check()
    return tuple(cable for cable in cables if cable is not None)


def refuse_without_cables(model: mujoco.MjModel) -> None:
    """Refuse an MJCF without a cable.

    Raises:
      RobotError: it has no tendon.
    """
    if model.ntendon == 0:
        raise RobotError("The MJCF has no tendon; a cable-driven robot needs at least one cable.")


@dataclass(frozen=True)
class _Tendons:
    """The tendons of a robot at its keyframe, with kinematics computed, each as a cable."""

    model: mujoco.MjModel
    data: mujoco.MjData
    bodies: tuple[Body, ...]
    points: tuple[TrackedPoint, ...]

    def winched(self, tendon: int, winch: int, actuator: int, act: Floats) -> Cable:
        """A cable with a winch, given the keyframe's activations (na,)."""
        model, name = self.model, self.model.tendon(tendon).name
        if model.tendon_stiffness[tendon] != 0:
            raise RobotError(
                f"The tendon {name!r} has a winch and its own stiffness; a winched cable's stiffness "
                "is its actuator's gainprm. Put a parallel spring on a separate tendon."
            )
        return Cable(
            name=name,
            ends=self._ends(tendon),
            stiffness=float(model.actuator_gainprm[actuator, 0]),
            damping=float(model.tendon_damping[tendon] - model.actuator_biasprm[actuator, 2]),
            rest_length=float(act[model.actuator_actadr[actuator]]),
            winch=winch,
        )

    def passive(self, tendon: int) -> Cable:
        """A cable that no winch drives."""
        model, name, ends = self.model, self.model.tendon(tendon).name, self._ends(tendon)
        stiffness, damping = model.tendon_stiffness[tendon], model.tendon_damping[tendon]
        low, rest = model.tendon_lengthspring[tendon]
        clamped = _clamped_actuator(model, tendon)
        if clamped is not None:
            pull, minus_k, minus_c = model.actuator_biasprm[clamped, :3]
            if stiffness == 0 and minus_k < 0:
                return Cable(name, ends, -minus_k, damping - minus_c, -pull / minus_k, -1)
        elif stiffness > 0 and low == 0 < rest:
            return Cable(name, ends, float(stiffness), float(damping), float(rest), -1)
        elif stiffness > 0:
            raise RobotError(
                f"The tendon {name!r} would push when shorter than {low:g} m; a cable only pulls: "
                f'write springlength="0 {rest:g}".'
            )
        raise RobotError(
            f"Nothing pulls the tendon {name!r}: it needs a winch, a stiffness, or one passive actuator "
            'with gainprm "0", biastype "affine", biasprm "k*L -k -c" and forcerange "-F 0".'
        )

    def _ends(self, tendon: int) -> tuple[Attachment, Attachment]:
        model, name = self.model, self.model.tendon(tendon).name
        if model.tendon_limited[tendon] and model.tendon_range[tendon, 0] > 0:
            raise RobotError(
                f"The tendon {name!r} would push when shorter than {model.tendon_range[tendon, 0]:g} m (its "
                "range); a cable only pulls: begin its range with 0."
            )
        path = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
        kinds = [
            mujoco.mjtWrap(int(k)).name.removeprefix("mjWRAP_").lower()
            for k in model.wrap_type[path]
        ]
        if kinds != ["site", "site"]:
            raise RobotError(
                f"The tendon {name!r} passes {' -> '.join(kinds)}; a cable is straight between exactly two "
                "sites (no joints, pulleys or wrapping)."
            )
        first, second = (self._attachment(int(site)) for site in model.wrap_objid[path])
        if first.body == second.body:
            where = "the world" if first.body < 0 else f"the body {self.bodies[first.body].name!r}"
            raise RobotError(
                f"The tendon {name!r} has both ends on {where}; a cable must connect two bodies, or one "
                "body with the world."
            )
        return first, second

    def _attachment(self, site: int) -> Attachment:
        body = body_index(self.model, self.model.site_bodyid[site])
        offset = in_body_frame(self.model, self.data, body, self.data.site_xpos[site])
        if body < 0:
            return Attachment(-1, offset, -1)

        def gap(point: int) -> tuple[float, ...]:
            """Distance to a point; ties are broken by position, not by number."""
            place = self.points[point].offset
            return round(float(np.linalg.norm(place - offset)), 9), *place

        return Attachment(body, offset, min(self.bodies[body].points, key=gap))


def _clamped_actuator(model: mujoco.MjModel, tendon: int) -> int | None:
    """The passive actuator on the tendon that can only pull, if there is exactly one."""
    found = [
        a
        for a in range(model.nu)
        if is_passive(model, a)
        and model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_TENDON
        and model.actuator_trnid[a, 0] == tendon
        and model.actuator_forcelimited[a]
        and model.actuator_forcerange[a, 1] <= 0
    ]
    return found[0] if len(found) == 1 else None
