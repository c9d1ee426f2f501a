"""How often is a diagnosis right? Effects are hidden in recordings of another simulator, and counted.

    python -m benchmarks.diagnosis FOLDER --groups single --sizes 1 --seeds 1 --only winch

Writes one JSON file per case into the folder. Cases that have one are not done again, so that it can be
stopped at any time. The table is printed, written to FOLDER/table.md and logged to FOLDER/mlflow.db.
`python -m benchmarks.tables collect diagnosis FOLDER` takes the results over into benchmarks/results/.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmarks.diagnosis.bench import examine, listed
from flywheel.cli.exits import CODES, OneCommand
from flywheel.cli.logs.diagnose import TrainedOption
from flywheel.cli.options import within
from flywheel.quantities import SAMPLES, Bounds

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command(cls=OneCommand, epilog=CODES)
def diagnosis(
    folder: Annotated[Path, typer.Argument(help="One result file per case.")],
    robot: Annotated[str, typer.Option(help="prism3, icosa6 or platform4.")] = "prism3",
    groups: Annotated[
        str,
        typer.Option(
            help="none, single, pairs, triples, outside, hard; and for robots with small errors "
            "in all numbers messy-none, messy-single, messy-pairs; and forms, laws outside "
            "the library."
        ),
    ] = "none,single,pairs,triples,outside,hard",
    sizes: Annotated[
        str, typer.Option(help="Sizes of single effects, in typical sizes.")
    ] = "0.5,1,2",
    seeds: Annotated[int, typer.Option(help="Cases of each kind.", callback=within(SAMPLES))] = 5,
    only: Annotated[str, typer.Option(help="Part of the names of the cases wanted.")] = "",
    spread: Annotated[
        float,
        typer.Option(
            help="Deviations of messy robots: 2 for twice as large.", callback=within(Bounds(0, 10))
        ),
    ] = 1.0,
    told: Annotated[
        bool,
        typer.Option(
            help=(
                "Give the diagnosis the deviations of messy robots, for an upper bound of its "
                "success."
            )
        ),
    ] = False,
    model: TrainedOption = None,
    address: Annotated[str | None, typer.Option(help="An existing Ray cluster.")] = None,
) -> None:
    """Hide effects in recordings of another simulator, have them diagnosed, and count.

    Cases that have a result in the folder are not done again, so that it can be stopped at any time.
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
