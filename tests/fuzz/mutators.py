"""Ways to spoil an input: its bytes, or what it says.

Every mutator takes an input and a source of chance, and returns a spoilt one. They know nothing of what
the input is for.
"""

import copy
import random
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

STRANGE_NUMBERS = (
    "0", "-0", "-1", "1", "2", "1e-300", "5e-324", "1e-9", "0.5", "1e3", "1e6", "1e9", "1e18", "1e200",
    "1e308", "-1e308", "1e999", "nan", "NaN", "inf", "-inf", "Infinity", "9" * 400, "9" * 5000, "0x1f",
    "1_000", "1,5", "--1", "+", ".", "1e", "True", "None",
)  # fmt: skip
STRANGE_TEXTS = (
    "", " ", "x", "..", "../x", "/etc/passwd", "a/b", "[red]x[/]", "[/]", "${a}", "${oc.env:HOME}", "\0",
    "\n", "\u202e", "é", "𝕏", "null", "true", "2020-02-31", "!!int foo", "&a [*a]", "*a", "{", "]", ":", "- ",
    "x" * 5000, "%s%n", "<a>", "&lt;", "]]>", "\\", "'", '"',
)  # fmt: skip
STRANGE_VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 10**30, 0.5, -0.0, 1e-300, 1e300, float("nan"), float("inf"), "", "x",
    "../x", [], {}, [[]], {"": ""}, ["x"] * 3, [1e300] * 3, {"a": {"b": [None]}}, "9" * 400,
)  # fmt: skip


def flipped(content: bytes, rng: random.Random) -> bytes:
    """Some bits are others."""
    out = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        if out:
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def cut_short(content: bytes, rng: random.Random) -> bytes:
    """The end is missing, as after a crash."""
    return content[: rng.randrange(len(content) + 1)]


def without_a_part(content: bytes, rng: random.Random) -> bytes:
    """A part in the middle is missing."""
    a, b = _part(content, rng)
    return content[:a] + content[b:]


def with_a_part_twice(content: bytes, rng: random.Random) -> bytes:
    """A part comes again somewhere else."""
    a, b = _part(content, rng)
    at = rng.randrange(len(content) + 1)
    return content[:at] + content[a:b] + content[at:]


def with_zeros(content: bytes, rng: random.Random) -> bytes:
    """A part is zeros, as on a bad disk."""
    a, b = _part(content, rng)
    return content[:a] + b"\0" * (b - a) + content[b:]


def with_noise(content: bytes, rng: random.Random) -> bytes:
    """A part is random bytes."""
    a, b = _part(content, rng)
    return content[:a] + rng.randbytes(b - a) + content[b:]


def recoded(content: bytes, rng: random.Random) -> bytes:
    """The text is in another encoding, or has other ends of lines."""
    text = content.decode("utf-8", "replace")
    return rng.choice(
        (
            text.encode("utf-16"),
            text.encode("utf-8-sig"),
            text.encode("utf-32"),
            ("é" + text).encode("latin-1", "replace"),
            text.replace("\n", "\r\n").encode(),
            text.replace("\n", "\r").encode(),
        )
    )


def with_other_words(content: bytes, rng: random.Random) -> bytes:
    """A word or a number is a strange one."""
    words = content.split(b" ") if rng.random() < 0.5 else content.split(b",")
    words[rng.randrange(len(words))] = rng.choice(STRANGE_NUMBERS + STRANGE_TEXTS).encode()
    return (b" " if rng.random() < 0.5 else b",").join(words)


def with_other_lines(content: bytes, rng: random.Random) -> bytes:
    """Lines are missing, doubled or exchanged."""
    lines = content.split(b"\n")
    for _ in range(rng.choice((1, 2, 5))):
        a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
        how = rng.randrange(3)
        if how == 0:
            lines[a] = b""
        elif how == 1:
            lines.insert(b, lines[a])
        else:
            lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


BYTES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    flipped, cut_short, without_a_part, with_a_part_twice, with_zeros, with_noise, recoded,
    with_other_words, with_other_lines,
)  # fmt: skip


def of_bytes(content: bytes, rng: random.Random) -> bytes:
    """Spoilt by one or two of the mutators of bytes."""
    for _ in range(rng.choice((1, 1, 1, 2))):
        content = rng.choice(BYTES)(content, rng)
    return content


def of_tree(tree: Any, rng: random.Random) -> Any:
    """Nested mappings and lists with one to three nodes that are something else."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.choice((1, 1, 2, 3))):
        places = list(_places(tree))
        if not places:
            return rng.choice(STRANGE_VALUES)
        parent, key = rng.choice(places)
        how = rng.randrange(6)
        if how == 0:
            del parent[key]
        elif how == 1 and isinstance(parent, dict):
            parent[rng.choice(STRANGE_TEXTS)] = parent[key]
        elif how == 1:
            parent.extend(copy.deepcopy(parent[:100]))
        elif how == 2:
            other, its = rng.choice(places)
            parent[key] = copy.deepcopy(other.get(its) if isinstance(other, dict) else parent[key])
        elif how == 3:
            for _ in range(rng.choice((1, 3, 40))):
                parent[key] = [parent[key]] if rng.random() < 0.5 else {"a": parent[key]}
        else:
            parent[key] = copy.deepcopy(rng.choice(STRANGE_VALUES))
    return tree


def of_xml(text: str, rng: random.Random) -> str:
    """XML with elements and attributes that are missing, doubled, moved or strange."""
    root = ElementTree.fromstring(text)
    for _ in range(rng.choice((1, 1, 2, 4))):
        elements = list(root.iter())
        parent = rng.choice([each for each in elements if len(each)] or [root])
        one = rng.choice(elements)
        how = rng.randrange(7)
        if how == 0 and len(parent):
            parent.remove(rng.choice(list(parent)))
        elif how == 1:
            parent.append(copy.deepcopy(one))
        elif how == 2:
            _wrapped(root, one, rng)
        elif how == 3:
            one.tag = rng.choice(elements).tag
        elif one.attrib:
            _with_another_attribute(one, rng.choice(elements), rng)
    return ElementTree.tostring(root, encoding="unicode")


def _with_another_attribute(
    one: ElementTree.Element, other: ElementTree.Element, rng: random.Random
) -> None:
    name = rng.choice(list(one.attrib))
    values = one.attrib[name].split()
    how = rng.randrange(5)
    if how == 0:
        del one.attrib[name]
    elif how == 1:
        one.attrib.update(other.attrib)
    elif how == 2:
        one.attrib[name] = rng.choice(STRANGE_TEXTS).replace("\0", "")
    else:
        at = rng.randrange(len(values)) if values else 0
        values[at : at + 1] = [rng.choice(STRANGE_NUMBERS)]
        one.attrib[name] = " ".join(values)


def _wrapped(root: ElementTree.Element, one: ElementTree.Element, rng: random.Random) -> None:
    """Put an element into another, many times over where that is a replicate."""
    parents = {child: parent for parent in root.iter() for child in parent}
    if one not in parents:
        return
    tag = rng.choice(("replicate", "body", "frame", "default", "composite", one.tag))
    around = ElementTree.Element(tag)
    if tag == "replicate":
        around.attrib |= {"count": rng.choice(("0", "2", "100", "100000", "-1")), "offset": "1 0 0"}
    place = list(parents[one]).index(one)
    parents[one].remove(one)
    around.append(one)
    parents[one].insert(place, around)


def of_rows(rows: list[list[str]], rng: random.Random) -> list[list[str]]:
    """A table with cells, rows or columns that are missing, doubled, exchanged or strange."""
    rows = [list(row) for row in rows]
    for _ in range(rng.choice((1, 1, 2, 3))):
        column = rng.randrange(len(rows[0]) or 1)
        rng.choice((_other_rows, _other_column, _other_column, _other_cell))(rows, column, rng)
    return rows


def _other_rows(rows: list[list[str]], column: int, rng: random.Random) -> None:
    at = rng.randrange(len(rows))
    if rng.random() < 0.5 and len(rows) > 2:
        del rows[at : at + rng.choice((1, 1, 10, 100))]
    else:
        rows.insert(rng.randrange(len(rows)), list(rows[at]))


def _other_column(rows: list[list[str]], column: int, rng: random.Random) -> None:
    how, strange = rng.randrange(4), rng.choice(STRANGE_NUMBERS)
    factor = rng.choice((-1.0, 1e-3, 1e3, 1e200, 1e-200, 0.0))
    for number, row in enumerate(rows):
        here = row[column : column + 1]
        if how == 0:
            del row[column : column + 1]
        elif how == 1:
            row.extend(here)
        elif number:
            row[column : column + 1] = [strange] if how == 2 else [_scaled(c, factor) for c in here]


def _other_cell(rows: list[list[str]], column: int, rng: random.Random) -> None:
    row = rng.choice(rows)
    row[column : column + 1] = [rng.choice(STRANGE_NUMBERS + STRANGE_TEXTS)]


def _scaled(cell: str, factor: float) -> str:
    try:
        return repr(factor * float(cell))
    except ValueError:
        return cell


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every (parent, key) of nested mappings and lists."""
    if isinstance(tree, dict | list):
        for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
            yield tree, key
            yield from _places(tree[key])


def _part(content: bytes, rng: random.Random) -> tuple[int, int]:
    a = rng.randrange(len(content) + 1)
    return a, min(len(content), a + rng.choice((1, 4, 64, 1000)))
