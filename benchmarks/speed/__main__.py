"""How fast does this machine plan, learn, simulate and store?

    python -m benchmarks.speed --threads 1,2 --only plant,plan

The numbers are printed as a table, and written to bench.json.
"""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path

import torch

from benchmarks.speed.benches import BENCHES, Measurement, machine
from flywheel.cli.app import App
from flywheel.cli.console import console, table
from flywheel.cli.exits import CODES, OneCommand
from flywheel.errors import ConfigError
from flywheel.files import shown
from flywheel.outputs import check_outputs, write_output
from flywheel.quantities import THREADS, EpisodeSeconds
from flywheel.registry import lookup
from flywheel.robots import load_robot
from flywheel.runtime.pool.progress import console_progress

ROBOT = "prism3"  # of all measurements

app = App(add_completion=False, pretty_exceptions_enable=False)


@app.command(cls=OneCommand, epilog=CODES)
def speed(
    *,
    threads: str = "1,2",
    seconds: EpisodeSeconds = 1.0,
    only: str = "",
    output: Path = Path("bench.json"),
) -> None:
    """Measure this machine: plant, network, planning and store.

    Args:
      threads: Numbers of threads, one after the other.
      seconds: Shortest measurement of one thing, in seconds.
      only: Only these, e.g. plant,plan; all by default.
      output: Output file for the numbers, as JSON.
    """
    counts = parsed_threads(threads)
    chosen = [name.strip() for name in only.split(",") if name.strip()] or list(BENCHES)
    benches = {name: lookup(BENCHES, name, "bench") for name in chosen}
    check_outputs({"JSON": output})
    robot = load_robot(ROBOT)
    found: list[Measurement] = []
    with console_progress().stage("bench", len(benches) * len(counts)) as stage:
        for done, (count, name) in enumerate((c, n) for c in counts for n in benches):
            stage.update(done, f"{name}, {count} threads")
            torch.set_num_threads(count)
            found += benches[name](robot, count, seconds)
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
    parts = [part.strip() for part in text.split(",")]
    counts = [int(part) for part in parts if re.fullmatch(r"[0-9]{1,4}", part)]
    if len(counts) < len(parts) or not all(count in THREADS for count in counts):
        raise ConfigError(
            f"--threads is a list of whole numbers {THREADS}, e.g. 1,2; got {shown(text)}."
        )
    return counts


if __name__ == "__main__":
    app(prog_name="python -m benchmarks.speed")
