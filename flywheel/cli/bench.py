"""`flywheel bench`: how fast this machine plans, learns, simulates and stores."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from flywheel.cli.console import console, table
from flywheel.cli.options import within
from flywheel.quantities import EPISODE_SECONDS, THREADS

ROBOT = "prism3"  # that all is measured with


def bench(
    threads: Annotated[str, typer.Option(help="Numbers of threads, one after the other.")] = "1,2",
    seconds: Annotated[
        float,
        typer.Option(
            help="Shortest measurement of one thing, in seconds.",
            callback=within(EPISODE_SECONDS),
        ),
    ] = 1.0,
    only: Annotated[
        str, typer.Option(help="Only these, e.g. plant,plan; all by default.", show_default=False)
    ] = "",
    output: Annotated[Path, typer.Option(help="Where the numbers go, as JSON.")] = Path(
        "bench.json"
    ),
) -> None:
    """Measure this machine: plant, network, planning and store.

    [bold]Example[/bold]

    flywheel bench --threads 1,2 --only plant,plan
    """
    import torch

    from flywheel.cli.benches import BENCHES, Measurement, machine
    from flywheel.outputs import check_outputs, write_output
    from flywheel.registry import lookup
    from flywheel.robots import load_robot
    from flywheel.runtime.pool.progress import console_progress

    counts = parsed_threads(threads)
    chosen = [name.strip() for name in only.split(",") if name.strip()] or list(BENCHES)
    benches = {name: lookup(BENCHES, name, "bench") for name in chosen}
    check_outputs({"JSON": output})
    loaded = load_robot(ROBOT)
    found: list[Measurement] = []
    with console_progress().stage("bench", len(benches) * len(counts)) as stage:
        for done, (count, name) in enumerate((c, n) for c in counts for n in benches):
            stage.update(done, f"{name}, {count} threads")
            torch.set_num_threads(count)
            found += benches[name](loaded, count, seconds)
    out = console()
    columns = ["what", "#value", "unit", "#threads", "against", "#times"]
    rows = [(m.of, m.value, m.unit, m.threads, m.against, m.ratio) for m in found]
    out.print(table(f"{ROBOT} on {machine()['processor']}", columns, rows))
    record = {"robot": ROBOT, "machine": machine(), "measurements": [asdict(m) for m in found]}
    write_output(output, json.dumps(record, indent=1) + "\n")
    out.say(f"Written to {output}")


def parsed_threads(text: str) -> list[int]:
    """Numbers of threads from "1,2".

    Raises:
      ConfigError: it is not such a list.
    """
    from flywheel.errors import ConfigError
    from flywheel.files import shown

    parts = [part.strip() for part in text.split(",")]
    counts = [int(part) for part in parts if re.fullmatch(r"[0-9]{1,4}", part)]
    if len(counts) < len(parts) or not all(count in THREADS for count in counts):
        raise ConfigError(
            f"--threads is a list of whole numbers {THREADS}, e.g. 1,2; got {shown(text)}."
        )
    return counts
