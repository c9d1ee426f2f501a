"""The shipped configurations, by name: `prism3`, `smoke`, `paper/s_course`.

In a checkout they are the files in its `configs/`; a wheel contains the same files within the
package.
"""

from __future__ import annotations

import re
from pathlib import Path

from flywheel.registry import lookup

PACKAGE = Path(__file__).parents[2]
FOLDERS = (PACKAGE / "configs", PACKAGE.parent / "configs")  # in a wheel, in a checkout
SUFFIXES = (".yaml", ".yml")


def shipped_configs() -> dict[str, Path]:
    """Name -> file."""
    folder = next((each for each in FOLDERS if each.is_dir()), None)
    files = sorted(folder.rglob("*.yaml")) if folder else []
    return {file.relative_to(folder).with_suffix("").as_posix(): file for file in files if folder}


def config_file(config: str | Path) -> Path:
    """The file of a configuration.

    Args:
      config: path of a YAML file (which need not exist), or a name.

    Raises:
      UnknownNameError: neither; the message has the nearest name.
    """
    path = Path(config)
    if path.suffix in SUFFIXES:
        return path
    return lookup(shipped_configs(), str(config), "configuration")


def copied_text(name: str) -> str:
    """A shipped configuration as the text of a file for any folder.

    Its base files are named, because they are not next to the copy.

    Raises:
      UnknownNameError: there is none of this name.
    """
    file = lookup(shipped_configs(), name, "configuration")
    folder = Path(name).parent

    def named(match: re.Match[str]) -> str:
        return re.sub(r"[\w./-]+\.yaml", lambda other: _normal(folder / other[0]), match[0])

    text = file.read_text(encoding="utf-8")
    return re.sub(r"^extends:.*$", named, text, flags=re.MULTILINE)


def _normal(path: Path) -> str:
    """The name of a file below the folder of all: `paper/../prism3.yaml` -> `prism3`."""
    parts: list[str] = []
    for part in path.with_suffix("").parts:
        if part == "..":
            parts.pop()
        else:
            parts.append(part)
    return "/".join(parts)
