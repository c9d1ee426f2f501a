"""Attributes of an MJCF's elements, with those that default classes give them."""

from __future__ import annotations

from xml.etree.ElementTree import Element


class Classes:
    """The default classes of an MJCF, before MuJoCo reads it.

    Args:
      root: of the MJCF; not edited meanwhile.
    """

    def __init__(self, root: Element) -> None:
        self._parents = {child: parent for parent in root.iter() for child in parent}
        outermost = root.findall("default")
        self._named = {each.get("class"): each for top in outermost for each in top.iter("default")}
        self._main = outermost

    def get(self, element: Element, key: str, otherwise: str = "") -> str:
        """An attribute of an element of a body, by itself or by its classes.

        Args:
          element: of a body.
          key: of the attribute.
          otherwise: MuJoCo's own default.
        """
        if key in element.attrib:
            return element.attrib[key]
        for default in self._chain(element):
            for settings in default.findall(element.tag):
                if key in settings.attrib:
                    return settings.attrib[key]
        return otherwise

    def is_default(self, element: Element) -> bool:
        """True for an element within <default>."""
        return self.parent(element).tag == "default"

    def parent(self, element: Element) -> Element:
        """The element around an element."""
        return self._parents[element]

    def body(self, element: Element) -> Element:
        """The body, or the <worldbody>, of an element within it."""
        while element.tag not in ("body", "worldbody"):
            element = self._parents[element]
        return element

    def _chain(self, element: Element) -> list[Element]:
        """The classes of an element, innermost first; the main class at the end."""
        name, around = element.get("class"), element
        while name is None and around in self._parents:
            around = self._parents[around]
            name = around.get("childclass")
        found = self._named.get(name) if name else None
        chain = []
        while found is not None and found.tag == "default":
            chain.append(found)
            found = self._parents.get(found)
        return [*chain, *(top for top in self._main if top not in chain)]
