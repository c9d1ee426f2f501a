"""The command line of a benchmark."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

ROOT = Path(__file__).parents[1]


def parser_of(file: str, about: str | None) -> ArgumentParser:
    """A parser that is named as the benchmark is run, and described by its docstring's first line.

    Args:
      file: of the benchmark.
      about: its docstring.
    """
    name = ".".join(Path(file).relative_to(ROOT).with_suffix("").parts).removesuffix(".__main__")
    return ArgumentParser(prog=f"python -m {name}", description=(about or "").splitlines()[0])
