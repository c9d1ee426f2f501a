"""Meshes: left out where they are only looked at, primitives in their places where they are touched."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from flywheel.errors import MjcfError
from flywheel.robots.adapt.classes import Classes
from flywheel.robots.adapt.draft import Certainty, Change, Draft, Element, digits, fresh_name
from flywheel.robots.mujoco_warnings import collected_warnings

LONG = 3.0  # times as long as wide: a capsule, else a box
SIZES = {"capsule": 2, "box": 3}  # numbers of a primitive's size
TURNS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")


def meshes(draft: Draft) -> Iterator[Change]:
    """An MJCF without meshes, whose bodies have the masses and inertias that these gave them.

    Raises:
      MjcfError: a mesh has a mass or is touched, and its file is missing or cannot be compiled.
    """
    assets = [mesh for section in draft.root.findall("asset") for mesh in section.findall("mesh")]
    if not assets:
        return
    classes = Classes(draft.root)
    geoms = [geom for geom in draft.root.iter("geom") if _shows(geom, classes)]
    touched = [geom for geom in geoms if _touches(geom, classes)]
    weighed = [geom for geom in geoms if _weighs(geom, classes, draft)]
    inertias = tuple(_write_inertias(draft, weighed, classes)) if weighed else ()
    fitted = tuple(_fit(draft, touched)) if touched else ()
    parents = draft.parents()
    for doomed in (*(geom for geom in geoms if geom not in touched), *assets):
        parents[doomed].remove(doomed)
    _drop_mesh_defaults(draft)
    if len(touched) < len(geoms) or not geoms:
        names = (mesh.get("name") or Path(mesh.get("file", "")).stem for mesh in assets)
        edits = tuple(f"no mesh {name!r}" for name in names)
        yield Change(edits, "They are only looked at.", Certainty.CERTAIN)
    if inertias:
        reason = "The masses and inertias of the meshes stay, as MuJoCo computes them."
        yield Change(inertias, reason, Certainty.CERTAIN)
    if fitted:
        reason = "Primitives that MuJoCo fits by inertia touch in the places of the meshes."
        yield Change(fitted, reason, Certainty.GUESS)


def _fit(draft: Draft, touched: list[Element]) -> Iterator[str]:
    """Put a capsule or a box in the place of each of some geoms with meshes."""
    taken = {geom.get("name", "") for geom in draft.root.iter("geom")}
    for geom in touched:
        if not geom.get("name"):
            geom.set("name", fresh_name("fitted", taken))
    shown = _with_files(draft)
    for geom in touched:
        half = np.sort(shown.geom_aabb[shown.geom(geom.get("name")).id, 3:])
        geom.set("type", "capsule" if half[2] > LONG * half[1] else "box")
    model = _with_files(draft)
    for geom in touched:
        found, shape = model.geom(geom.get("name")), geom.get("type", "")
        for key in ("mesh", "fitscale", "fromto", *TURNS):
            geom.attrib.pop(key, None)
        geom.attrib |= {
            "size": digits(*found.size[: SIZES[shape]]),
            "pos": digits(*found.pos),
            "quat": digits(*found.quat),
        }
        yield f'type="{shape}" size="{geom.get("size")}" for the mesh of {geom.get("name")!r}'


def _shows(geom: Element, classes: Classes) -> bool:
    """True for a geom of a body that is drawn as a mesh."""
    return not classes.is_default(geom) and bool(classes.get(geom, "mesh"))


def _touches(geom: Element, classes: Classes) -> bool:
    return any(classes.get(geom, kind, "1") != "0" for kind in ("contype", "conaffinity"))


def _weighs(geom: Element, classes: Classes, draft: Draft) -> bool:
    """True if a geom's mass counts for its body's."""
    if classes.parent(geom).tag == "worldbody":
        return False
    compiler = draft.root.find("compiler")
    always = compiler is not None and compiler.get("inertiafromgeom") == "true"
    given = classes.body(geom).find("inertial") is not None
    massless = "0" in (classes.get(geom, "mass"), classes.get(geom, "density"))
    return not massless and (always or not given)


def _write_inertias(draft: Draft, geoms: list[Element], classes: Classes) -> Iterator[str]:
    """Give the bodies of some geoms the inertias that MuJoCo computes from all of theirs."""
    bodies = list(draft.root.iter("body"))
    for number, body in enumerate(bodies):
        if not body.get("name"):
            body.set("name", f"body{number + 1}")
    model = _with_files(draft)
    compiler = draft.section("compiler")
    if compiler.get("inertiafromgeom") == "true":
        compiler.set("inertiafromgeom", "auto")
    for body in {classes.body(geom): None for geom in geoms}:
        found = model.body(body.get("name"))
        if (old := body.find("inertial")) is not None:
            body.remove(old)
        inertial = Element(
            "inertial",
            pos=digits(*found.ipos),
            quat=digits(*found.iquat),
            mass=digits(*found.mass),
            diaginertia=digits(*found.inertia),
        )
        body.insert(0, inertial)
        yield f'<inertial mass="{digits(*found.mass)}" ...> of the body {body.get("name")!r}'


def _with_files(draft: Draft) -> mujoco.MjModel:
    """MuJoCo's model of a draft that still reads its meshes."""
    try:
        with collected_warnings():
            spec = mujoco.MjSpec.from_string(draft.xml)
            spec.modelfiledir = str(draft.folder)
            return spec.compile()
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
        words = " ".join(str(error).split())
        raise MjcfError(
            f"The MJCF has meshes with masses, and MuJoCo cannot compile them: {words}. Their files are "
            "needed once, or <inertial> in their bodies."
        ) from error


def _drop_mesh_defaults(draft: Draft) -> None:
    for default in draft.root.iter("default"):
        for geom in default.findall("geom"):
            geom.attrib.pop("mesh", None)
            if geom.get("type") == "mesh":
                del geom.attrib["type"]
        for mesh in default.findall("mesh"):
            default.remove(mesh)
