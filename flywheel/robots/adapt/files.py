"""Other files that an MJCF includes, or shows: taken in, or left out."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from flywheel.errors import MjcfError
from flywheel.robots.adapt.draft import Certainty, Change, Draft, Element
from flywheel.robots.mjcf_source import MOST_ELEMENTS, PICTURES, parsed, read_mjcf

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
        if (count := sum(1 for _ in draft.root.iter())) > MOST_ELEMENTS:
            raise MjcfError(
                f"The MJCF has {count:,} elements with its included files; at most {MOST_ELEMENTS:,} are "
                "allowed."
            )
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
    """An MJCF without textures from files and skins."""
    edits = [*_without_textures(draft), *_without_skins(draft)]
    if edits:
        yield Change(tuple(edits), "They are only looked at.", Certainty.CERTAIN)


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
