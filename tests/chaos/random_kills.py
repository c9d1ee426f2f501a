"""Kill drivers and workers at random instants until there were enough, and compare every outcome.

    python -m tests.chaos.random_kills --kills 30 --work FOLDER --report faults.md

Each run is killed several times, resumed, and has to end with the digests, errors and walks of a
run that was left in peace.
"""

import argparse
import random
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

from tests.chaos.killing import ROOT, busy_workers, kill, outcome, start_driver

DRIVER = "driver"
LONG = 3600
DRIVERS_SHARE = 0.3  # of the kills at instants at which a worker is busy
CONFIG = ROOT / "configs" / "smoke.yaml"


def undisturbed(folder: Path, overrides: list[str]) -> tuple[dict[str, str], float]:
    """Outcome and duration [s] of a run that nobody kills."""
    begun = time.monotonic()
    driver = start_driver(CONFIG, folder, overrides)
    assert driver.wait(LONG) == 0, folder.with_suffix(".log").read_text()[-3000:]
    return outcome(folder), time.monotonic() - begun


def disturbed(
    folder: Path, overrides: list[str], rng: random.Random, pause: float, kills: int
) -> tuple[dict[str, str], list[tuple[str, float]]]:
    """Outcome of a run that is killed `kills` times, and what was killed when [s]."""
    done: list[tuple[str, float]] = []
    begun = time.monotonic()
    driver = start_driver(CONFIG, folder, overrides)
    while len(done) < kills:
        if not _lives_for(driver, rng.uniform(2.0, pause)):
            assert driver.returncode == 0, folder.with_suffix(".log").read_text()[-3000:]
            break
        workers = busy_workers(driver.pid)
        kinds = sorted(set(workers.values()))
        wanted = rng.choice(kinds) if kinds and rng.random() > DRIVERS_SHARE else DRIVER
        pids = [driver.pid] if wanted == DRIVER else [p for p, k in workers.items() if k == wanted]
        if not kill(rng.choice(pids)):
            continue
        done.append((wanted, time.monotonic() - begun))
        if wanted == DRIVER:
            driver.wait()
            driver = start_driver(CONFIG, folder, overrides)
    assert driver.wait(LONG) == 0, folder.with_suffix(".log").read_text()[-3000:]
    return outcome(folder), done


def _lives_for(driver: subprocess.Popen[bytes], seconds: float) -> bool:
    try:
        driver.wait(seconds)
    except subprocess.TimeoutExpired:
        return True
    return False


def main() -> int:
    """Kill, compare, report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--per-run", type=int, default=5)
    parser.add_argument("--pause", type=float, help="longest, between two kills [s]")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--report", type=Path)
    parser.add_argument("overrides", nargs="*")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    expected, duration = undisturbed(options.work / "peace", options.overrides)
    lines, counts, total, wrong = [], Counter[str](), 0, 0
    run = 0
    while total < options.kills:
        run += 1
        folder = options.work / f"run{run:02d}"
        pause = options.pause or duration / 2
        got, kills = disturbed(folder, options.overrides, rng, pause, options.per_run)
        different = [key for key in expected if got.get(key) != expected[key]]
        wrong += bool(different)
        total += len(kills)
        counts.update(kind for kind, _ in kills)
        what = ", ".join(f"{kind} at {when:.0f} s" for kind, when in kills)
        verdict = "the same" if not different else f"DIFFERENT: {', '.join(different)}"
        lines.append(f"| {run} | {what} | {verdict} |")
        sys.stdout.write(lines[-1] + "\n")
        sys.stdout.flush()
    summary = (
        f"{total} kills (seed {options.seed}): "
        f"{', '.join(f'{n} x {k}' for k, n in sorted(counts.items()))}; {run} runs, {wrong} with "
        f"another outcome. A run that is left in peace takes {duration:.0f} s; {len(expected)} values "
        "of each (digests, errors, walks) are compared with it."
    )
    sys.stdout.write(summary + "\n")
    if options.report:
        table = ["| run | killed with SIGKILL | outcome |", "|---|---|---|", *lines]
        options.report.write_text("\n".join([summary, "", *table]) + "\n")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
