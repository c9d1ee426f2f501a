"""How often is a diagnosis right? Effects are hidden in recordings of another simulator, and counted.

    python -m benchmarks.diagnosis FOLDER --groups single --sizes 1 --seeds 1 --only winch

Writes one JSON file per case into the folder. Cases that have one are not done again, so that it can be
stopped at any time. The table is printed, written to FOLDER/table.md and logged to FOLDER/mlflow.db.
`python -m benchmarks.tables collect diagnosis FOLDER` takes the results over into benchmarks/results/.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from benchmarks.diagnosis.bench import examine, listed
from flywheel.cli.app import App
from flywheel.cli.exits import CODES, OneCommand
from flywheel.quantities import Bounds, Samples

app = App(add_completion=False, pretty_exceptions_enable=False)


@app.command(cls=OneCommand, epilog=CODES)
def diagnosis(
    folder: Path,
    *,
    robot: str = "prism3",
    groups: str = "none,single,pairs,triples,outside,hard",
    sizes: str = "0.5,1,2",
    seeds: Samples = 5,
    only: str = "",
    spread: Annotated[float, Bounds(0, 10)] = 1.0,
    told: bool = False,
    model: Annotated[str | None, "[LABEL=]SPEC"] = None,
    address: str | None = None,
) -> None:
    """Hide effects in recordings of another simulator, have them diagnosed, and count.

    Cases that have a result in the folder are not done again, so that it can be stopped at any time.

    Args:
      folder: One result file per case.
      robot: prism3, icosa6 or platform4.
      groups: none, single, pairs, triples, outside, hard; and for robots with small errors in all numbers
        messy-none, messy-single, messy-pairs; and forms, laws outside the library.
      sizes: Sizes of single effects, in typical sizes.
      seeds: Cases of each kind.
      only: Part of the names of the cases wanted.
      spread: Deviations of messy robots: 2 for twice as large.
      told: Give the diagnosis the deviations of messy robots, for an upper bound of its success.
      model: A trained model to test instead of the plant: a run's folder (its champion), RUN:NAME, or a
        file of weights.
      address: An existing Ray cluster.
    """
    examine(
        folder,
        robot,
        groups.split(","),
        listed(sizes),
        range(seeds),
        only,
        model,
        address,
        spread,
        told,
    )


if __name__ == "__main__":
    app(prog_name="python -m benchmarks.diagnosis")
