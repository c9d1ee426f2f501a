"""Tracked points for bodies that have none: end spheres, ends of capsules, or where cables end."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree import ElementTree

import mujoco
import numpy as np

from flywheel.records import Floats
from flywheel.robots.adapt.draft import Certainty, Change, Draft, at_start, digits, fresh_name
from flywheel.robots.bodies import body_index, in_body_frame, moving_bodies

SAME = 1e-6  # [m]; nearer is the same place
LONG = [int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)]
TOP = ((1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1))  # corners of a box, seen from above
ENOUGH = 2  # of points, for a body that is long
SLENDER = 0.25  # of a rod's length: its cables end nearer to its axis


def points(draft: Draft) -> Iterator[Change]:
    """Sites and position sensors on the moving bodies that nothing measures."""
    model = draft.model
    data, edits = at_start(model), []
    measured = set(_measured(model))
    sites = {model.site(i).name for i in range(model.nsite)}
    sensors = {model.sensor(i).name for i in range(model.nsensor)}
    for index, body in enumerate(moving_bodies(model)):
        if index in measured:
            continue
        name = model.body(body).name
        places = _places(model, data, index, body)
        for number, (words, place) in enumerate(places):
            site = _site_at(model, data, index, place)
            if site is None:
                site = fresh_name(f"{name}_{number}", sites)
                attributes = {"name": site, "pos": digits(*place)}
                ElementTree.SubElement(draft.body(name), "site", attributes)
            sensor = fresh_name(f"{name}_{number}", sensors)
            attributes = {"name": sensor, "objtype": "site", "objname": site}
            ElementTree.SubElement(draft.section("sensor"), "framepos", attributes)
            edits.append(f"{sensor!r} at {words} of {name!r}")
    if edits:
        reason = (
            "The position of a body is seen by points on it; markers elsewhere are to be moved."
        )
        yield Change(tuple(edits), reason, Certainty.GUESS)


def _measured(model: mujoco.MjModel) -> Iterator[int]:
    """Moving bodies, as indices, with a position sensor of a site in the world."""
    for sensor in range(model.nsensor):
        position = model.sensor_type[sensor] == mujoco.mjtSensor.mjSENS_FRAMEPOS
        of_site = model.sensor_objtype[sensor] == mujoco.mjtObj.mjOBJ_SITE
        if position and of_site and model.sensor_refid[sensor] < 0:
            yield body_index(model, int(model.site_bodyid[model.sensor_objid[sensor]]))


def _places(
    model: mujoco.MjModel, data: mujoco.MjData, index: int, body: int
) -> list[tuple[str, Floats]]:
    """Places in the body's frame (3,) [m] that are worth seeing, each with its words.

    Places on a line tell the pose of a rod only, whose cables end near that line.
    """
    ends = [in_body_frame(model, data, index, data.site_xpos[s]) for s in _cable_ends(model, body)]
    proposed = [each for each in _proposed(model, data, index, body, ends) if len(each) >= ENOUGH]
    told = [each for each in proposed if _tells_pose([place for _, place in each], ends)]
    return next(iter([*told, *proposed]), [("the origin", np.zeros(3))])


def _tells_pose(places: list[Floats], ends: list[Floats]) -> bool:
    """True for places that are not on a line, or on that of a rod whose cables have these ends."""
    here = np.array(places)
    middle = here.mean(axis=0)
    _, spread, axes = np.linalg.svd(here - middle)
    if len(places) > ENOUGH and spread[1] > SAME:
        return True
    off = np.array(ends).reshape(-1, 3) - middle
    across = np.linalg.norm(off - np.outer(off @ axes[0], axes[0]), axis=1)
    return bool((across < SLENDER * np.ptp((here - middle) @ axes[0])).all())


def _proposed(
    model: mujoco.MjModel, data: mujoco.MjData, index: int, body: int, ends: list[Floats]
) -> Iterator[list[tuple[str, Floats]]]:
    """Places by the body's shape, then those where its cables end (3,) [m], each with its words."""
    geoms = np.flatnonzero(model.body_weldid[model.geom_bodyid] == body).tolist()

    def local(place: Floats) -> Floats:
        return in_body_frame(model, data, index, place)

    spheres = [g for g in geoms if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_SPHERE]
    yield [("a sphere", local(data.geom_xpos[g])) for g in spheres]
    long = [g for g in geoms if int(model.geom_type[g]) in LONG]
    if long:
        longest = max(long, key=lambda g: model.geom_size[g, 1])
        half = data.geom_xmat[longest].reshape(3, 3)[:, 2] * model.geom_size[longest, 1]
        both = (data.geom_xpos[longest] - half, data.geom_xpos[longest] + half)
        yield [("an end", local(end)) for end in both]
    boxes = [g for g in geoms if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_BOX]
    if boxes:
        largest = max(boxes, key=lambda g: float(model.geom_size[g].prod()))
        turn, size = data.geom_xmat[largest].reshape(3, 3), model.geom_size[largest]
        corners = (data.geom_xpos[largest] + turn @ (size * corner) for corner in TOP)
        yield [("an upper corner", local(corner)) for corner in corners]
    yield [("an end of a cable", end) for end in _distinct(ends)]


def _cable_ends(model: mujoco.MjModel, body: int) -> list[int]:
    of_site = model.wrap_type == mujoco.mjtWrap.mjWRAP_SITE
    sites = dict.fromkeys(model.wrap_objid[of_site].tolist())
    return [s for s in sites if model.body_weldid[model.site_bodyid[s]] == body]


def _distinct(places: list[Floats]) -> list[Floats]:
    kept: list[Floats] = []
    for place in places:
        if all(np.linalg.norm(place - other) > SAME for other in kept):
            kept.append(place)
    return kept


def _site_at(model: mujoco.MjModel, data: mujoco.MjData, index: int, place: Floats) -> str | None:
    """The name of a site of a moving body at a place in its frame (3,) [m]."""
    for site in range(model.nsite):
        if body_index(model, int(model.site_bodyid[site])) == index and model.site(site).name:
            here = in_body_frame(model, data, index, data.site_xpos[site])
            if np.linalg.norm(here - place) < SAME:
                return str(model.site(site).name)
    return None
