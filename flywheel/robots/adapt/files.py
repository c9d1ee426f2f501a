"""Other files that an MJCF reads: taken in, or left out where they are only looked at."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco

from flywheel.errors import MjcfError
from flywheel.robots.adapt.classes import Classes
from flywheel.robots.adapt.draft import Certainty, Change, Draft, Element, digits
from flywheel.robots.mjcf_source import PICTURES, parsed, read_mjcf
from flywheel.robots.mujoco_warnings import collected_warnings

MOST_FILES = 100  # that are taken in


def includes(draft: Draft) -> Iterator[Change]:
    """The elements of included files in the places of the includes.

    Raises:
      MjcfError: such a file is missing, is included twice, or there are too many.
    """
    taken: list[str] = []
    while (found := draft.root.find(".//include")) is not None:
        file = found.get("file", "")
        if file in taken or len(taken) == MOST_FILES:
            raise MjcfError(
                f"The MJCF includes {file!r} twice, or more than {MOST_FILES} files, which MuJoCo refuses."
            )
        parent = draft.parents()[found]
        place = list(parent).index(found)
        parent.remove(found)
        for offset, child in enumerate(_contents(draft.folder, file)):
            parent.insert(place + offset, child)
        taken.append(file)
    if taken:
        edits = tuple(f"the elements of {file} in the place of its <include>" for file in taken)
        yield Change(edits, "A robot is one file.", Certainty.CERTAIN)


def _contents(folder: Path, file: str) -> list[Element]:
    path = folder / file
    if not file or not path.is_file():
        raise MjcfError(f"The MJCF includes {file!r}, which is not in the folder {str(folder)!r}.")
    text = (
        read_mjcf(path).replace("<mujocoinclude", "<mujoco").replace("</mujocoinclude", "</mujoco")
    )
    return list(parsed(text, f"The included file {file!r}", comments=True))


def pictures(draft: Draft) -> Iterator[Change]:
    """An MJCF without textures from files, skins, and meshes that are only looked at.

    Raises:
      MjcfError: a mesh has a mass or is touched, and its file is missing or cannot be compiled.
    """
    edits = [*_without_textures(draft), *_without_skins(draft)]
    if edits:
        yield Change(tuple(edits), "They are only looked at.", Certainty.CERTAIN)
    yield from _without_meshes(draft)


def _without_textures(draft: Draft) -> Iterator[str]:
    parents = draft.parents()
    for texture in list(draft.root.iter("texture")):
        if not any(key.startswith(PICTURES) for key in texture.attrib):
            continue
        name = texture.get("name") or Path(texture.get("file", "")).stem
        parents[texture].remove(texture)
        for material in draft.root.iter("material"):
            if material.get("texture") == name:
                del material.attrib["texture"]
            for layer in material.findall("layer"):
                if layer.get("texture") == name:
                    material.remove(layer)
        yield f"no texture {name!r}"


def _without_skins(draft: Draft) -> Iterator[str]:
    parents = draft.parents()
    for skin in list(draft.root.iter("skin")):
        parents[skin].remove(skin)
        if not len(parents[skin]):
            draft.remove(parents[skin])
        yield f"no skin {skin.get('name', '')!r}"


def _without_meshes(draft: Draft) -> Iterator[Change]:
    assets = [mesh for section in draft.root.findall("asset") for mesh in section.findall("mesh")]
    if not assets:
        return
    classes = Classes(draft.root)
    geoms = [geom for geom in draft.root.iter("geom") if _shows(geom, classes)]
    touched = [geom for geom in geoms if _touches(geom, classes)]
    if touched:
        names = ", ".join(repr(geom.get("name") or classes.get(geom, "mesh")) for geom in touched)
        raise MjcfError(
            f"The MJCF has meshes that can be touched ({names}); put primitives in their places (type "
            '"capsule", "box" ...), or switch their contacts off (contype="0" conaffinity="0").'
        )
    weighed = [geom for geom in geoms if _weighs(geom, classes, draft)]
    inertias = tuple(_write_inertias(draft, weighed, classes)) if weighed else ()
    parents = draft.parents()
    for doomed in (*geoms, *assets):
        parents[doomed].remove(doomed)
    _drop_mesh_defaults(draft)
    edits = tuple(
        f"no mesh {mesh.get('name') or Path(mesh.get('file', '')).stem!r}" for mesh in assets
    )
    yield Change(edits, "They are only looked at.", Certainty.CERTAIN)
    if inertias:
        reason = "The masses and inertias of the meshes stay, as MuJoCo computes them."
        yield Change(inertias, reason, Certainty.CERTAIN)


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
