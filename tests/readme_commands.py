"""The two commands of the README, one per line, for the tests and for .ci/run."""

import re
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def code_blocks(text: str, language: str) -> list[str]:
    """The contents of a Markdown text's fenced blocks in one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def the_two_commands() -> list[str]:
    """The commands under "Two commands"."""
    section = README.read_text().split("## Two commands")[1].split("\n## ")[0]
    return [block.strip() for block in code_blocks(section, "bash")]


if __name__ == "__main__":
    print("\n".join(the_two_commands()))
