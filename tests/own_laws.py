"""Law files for tests."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[1] / "docs" / "own_effect.md"
COGGING = next(
    code
    for code in re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    if code.startswith("# my_laws.py\n")
)
# The smallest law that is one.
FRICTION = '''
from flywheel.effects import Parameter, TensionEffect

class Rub(TensionEffect):
    """Rubs."""

    name = "rub"
    sizes = (Parameter("force", "N", lambda s: 0.01 * s.weight),)
    equation = "dT = F tanh(V / v0)"
    source = "made up"
    shown_by = "strokes"

    def tension(self, cables, memory, values):
        return values["force"] * cables.direction, memory
'''


def law_file(folder: Path, text: str = COGGING, name: str = "my_laws.py") -> Path:
    """Write a law file."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(text)
    return path
