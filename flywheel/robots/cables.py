"""Cables: the MJCF's tendons, each between two sites."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np

from flywheel.errors import RobotError
from flywheel.records import Floats
from flywheel.robots.bodies import body_index, in_body_frame
from flywheel.robots.parts import Attachment, Body, Cable, TrackedPoint, Winch
from flywheel.robots.problems import Alike, Problems, called
from flywheel.robots.winches import is_passive, kind_of

BENT = "{} must be straight between exactly two sites (no joints, pulleys or wrapping); got {}."
SHOWN = 6  # of the elements on a tendon's path
GEOMS = {"sphere": "geom", "cylinder": "geom"}  # MuJoCo's words for what a tendon wraps around


def read_cables(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    bodies: tuple[Body, ...],
    points: tuple[TrackedPoint, ...],
    winches: tuple[Winch, ...] | None,
    act: Floats,
) -> tuple[Cable, ...]:
    """The cables, in the order of the MJCF's tendons, but for those that `refuse_bent` refuses.

    Args:
      data: with kinematics computed at the keyframe.
      bodies: none if they cannot be read.
      winches: None if they cannot be read; then what the MJCF drives counts as winched.
      act: (na,) the keyframe's activations.

    Raises:
      RobotError: tendons that could push, that nothing pulls, or that a winch and a spring pull.
    """
    actuators = {
        cable: (index, actuator)
        for index, winch in enumerate(winches or ())
        for cable, actuator in zip(winch.cables, winch.actuators, strict=True)
    }
    if winches is None:
        actuators = {cable: (-1, actuator) for cable, actuator in _driven(model).items()}
    problems, cables, tendons = Problems(), [], _Tendons(model, data, bodies, points)
    for tendon in range(model.ntendon):
        if _bend(model, tendon):
            continue
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


def refuse_bent(model: mujoco.MjModel) -> None:
    """Refuse tendons that are no straight line between two bodies.

    Raises:
      RobotError: there are such tendons; it says all of them.
    """
    problems = Problems()
    for tendon in range(model.ntendon):
        if words := _bend(model, tendon):
            problems.add_alike("tendon", called(model, "tendon", tendon), words)
    problems.check()


def _bend(model: mujoco.MjModel, tendon: int) -> str:
    """Sentence with {} for a tendon that is no straight line between two bodies; "" if it is one."""
    path = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
    kinds = [
        mujoco.mjtWrap(int(k)).name.removeprefix("mjWRAP_").lower() for k in model.wrap_type[path]
    ]
    if kinds != ["site", "site"]:
        return about_bent([GEOMS.get(kind, kind) for kind in kinds])
    first, second = (model.body_weldid[model.site_bodyid[site]] for site in model.wrap_objid[path])
    if first == second:
        where = f"the body {model.body(first).name!r}" if first else "the world"
        return (
            f"{{}} must connect two bodies, or one body with the world; got both ends on {where}."
        )
    return ""


def about_bent(path: Sequence[str]) -> str:
    """A sentence, with {} for the tendon, about the elements that it passes."""
    more = [] if len(path) <= SHOWN else [f"... ({len(path)} in all)"]
    return BENT.format("{}", " -> ".join([*path[:SHOWN], *more]))


def curved(model: mujoco.MjModel, tendon: int) -> bool:
    """True for a tendon whose stiffness or damping is a polynomial."""
    on = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (
        model.actuator_trnid[:, 0] == tendon
    )
    curves = (
        model.tendon_stiffnesspoly[tendon],
        model.tendon_dampingpoly[tendon],
        model.actuator_dampingpoly[on],
    )
    return any(curve.any() for curve in curves)


def _damping(model: mujoco.MjModel, actuator: int) -> float:
    """Damping of an actuator [N s/m]: of its force, and beside it."""
    return float(model.actuator_damping[actuator] - model.actuator_biasprm[actuator, 2])


def _driven(model: mujoco.MjModel) -> dict[int, int]:
    """Tendons on which there is an actuator that a control drives, and that actuator."""
    on_tendon = model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    found = np.flatnonzero(on_tendon).tolist()
    return {int(model.actuator_trnid[a, 0]): a for a in found if not is_passive(model, a)}


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
            raise Alike(
                "tendon",
                called(model, "tendon", tendon),
                "{} must not have a winch and a stiffness; a winched cable's stiffness is its actuator's "
                "gainprm. Put a parallel spring on a separate tendon.",
            )
        told = winch < 0 or kind_of(model, actuator) == "tension"
        return Cable(
            name=name,
            ends=self._ends(tendon),
            stiffness=0.0 if told else float(model.actuator_gainprm[actuator, 0]),
            damping=float(model.tendon_damping[tendon] + _damping(model, actuator)),
            rest_length=0.0 if told else float(act[model.actuator_actadr[actuator]]),
            winch=winch,
            strongest=-float(model.actuator_forcerange[actuator, 0]),
        )

    def passive(self, tendon: int) -> Cable:
        """A cable that no winch drives."""
        model, name, ends = self.model, self.model.tendon(tendon).name, self._ends(tendon)
        stiffness, damping = model.tendon_stiffness[tendon], model.tendon_damping[tendon]
        low, rest = model.tendon_lengthspring[tendon]
        clamped = clamped_actuator(model, tendon)
        if clamped is not None:
            pull, minus_k = model.actuator_biasprm[clamped, :2]
            damping += _damping(model, clamped)
            if stiffness == 0 and minus_k < 0:
                return Cable(name, ends, -minus_k, damping, -pull / minus_k, -1)
        elif stiffness > 0 and low == 0 < rest:
            return Cable(name, ends, float(stiffness), float(damping), float(rest), -1)
        elif stiffness > 0:
            raise Alike(
                "tendon",
                f"{called(model, 'tendon', tendon)} ({rest:g} m)",
                "{} would push when shorter than that (springlength); a cable only pulls: write "
                'springlength="0 L".',
            )
        raise Alike(
            "tendon",
            called(model, "tendon", tendon),
            "Nothing pulls {}: a cable needs a winch, a stiffness, or one passive actuator with "
            'gainprm "0", biastype "affine", biasprm "k*L -k -c" and forcerange "-F 0".',
        )

    def _refuse_curved(self, tendon: int) -> None:
        if curved(self.model, tendon):
            raise Alike(
                "tendon",
                called(self.model, "tendon", tendon),
                "{} must have a stiffness and a damping of one number each; polynomials are effects.",
            )

    def _ends(self, tendon: int) -> tuple[Attachment, Attachment]:
        model = self.model
        self._refuse_curved(tendon)
        if model.tendon_limited[tendon] and model.tendon_range[tendon, 0] > 0:
            raise Alike(
                "tendon",
                f"{called(model, 'tendon', tendon)} ({model.tendon_range[tendon, 0]:g} m)",
                "{} would push when shorter than that (range); a cable only pulls: begin the range with 0.",
            )
        start = model.tendon_adr[tendon]
        first, second = (self._attachment(int(s)) for s in model.wrap_objid[start : start + 2])
        return first, second

    def _attachment(self, site: int) -> Attachment:
        body = body_index(self.model, self.model.site_bodyid[site])
        offset = in_body_frame(self.model, self.data, body, self.data.site_xpos[site])
        if body < 0 or not self.bodies:
            return Attachment(body, offset, -1)

        def gap(point: int) -> tuple[float, ...]:
            """Distance to a point; ties are broken by position, not by number."""
            place = self.points[point].offset
            return round(float(np.linalg.norm(place - offset)), 9), *place

        return Attachment(body, offset, min(self.bodies[body].points, key=gap))


def clamped_actuator(model: mujoco.MjModel, tendon: int) -> int | None:
    """The passive actuator on the tendon that can only pull, if there is exactly one."""
    found = [
        a
        for a in range(model.nu)
        if is_passive(model, a)
        and model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_TENDON
        and model.actuator_trnid[a, 0] == tendon
        and model.actuator_forcelimited[a]
        and model.actuator_forcerange[a, 1] == 0
    ]
    return found[0] if len(found) == 1 else None
