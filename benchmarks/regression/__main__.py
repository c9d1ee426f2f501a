"""A check that measurable results are unchanged after code was moved.

    python -m benchmarks.regression record    before a change: writes answers.json
    python -m benchmarks.regression check     after it: compares with answers.json

Sixteen commands on short logs of the truth simulator (diagnoses, a comparison, a power and a design
answer) and one run of `configs/smoke.yaml`: verdicts, effects and numbers must agree to 1e-9,
stored arrays and networks bit by bit. Fields that were renamed or added since then are in
`renamed.json`. Other processors round differently: record and check on one machine, and record on
the commit before the change, as `answers.json` may be older. With `--only`, the answers of the other
cases stay.

`another-law` is EFFECT: where friction is hidden and not on offer, a damping of each cable predicts
windows left out nearly as well in 1.5 s (97 % of the error beyond noise, 101 % by friction).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.regression.cases import CASES, Case
from benchmarks.regression.compare import Fields, differences
from benchmarks.regression.smoke import of_run

ROOT = Path(__file__).resolve().parents[2]
ANSWERS = Path(__file__).with_name("answers.json")
RENAMED = Path(__file__).with_name("renamed.json")
COMMAND = (sys.executable, "-m", "flywheel.cli")
FINE = (0, 10, 11, 12, 13, 20, 21)  # exit codes that are verdicts
DROPPED = {"seconds", "cpu_seconds", "plan_seconds", "seal"}
SHOWN = 12  # differences of one case


def main() -> int:
    """Record or check, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.regression")
    parser.add_argument("what", choices=("record", "check"))
    parser.add_argument("--only", default="", help="part of the names of the cases wanted")
    parser.add_argument("--answers", type=Path, default=ANSWERS)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    given = parser.parse_args()
    with TemporaryDirectory() as folder:
        found = _answers(Path(folder), given.only, given.workers)
    if given.what == "record":
        others = json.loads(given.answers.read_text()) if given.only else {}
        text = json.dumps({**others, **found}, indent=0, sort_keys=True)
        given.answers.write_text(text + "\n")
        return 0
    fields = Fields(**json.loads(RENAMED.read_text()))
    before, wrong = json.loads(given.answers.read_text()), 0
    for name, answer in found.items():
        off = list(differences(before[name], answer, fields))
        wrong += bool(off)
        print(f"{name}: {f'{len(off)} differences' if off else 'the same'}")
        for line in off[:SHOWN]:
            print("  ", line)
    return int(wrong > 0)


def _answers(folder: Path, only: str, workers: int) -> dict[str, Any]:
    wanted = [case for case in CASES if only in case.name]
    run, found = folder / "smoke", {}
    if only in "smoke" or any(case.needs_run for case in wanted):
        _call(["run", str(ROOT / "configs" / "smoke.yaml"), "--folder", str(run)], folder, "smoke")
        found["smoke"] = _stripped(of_run(run))
    with ThreadPoolExecutor(workers) as pool:
        made = pool.map(lambda case: _answer(case, folder / case.name, run), wanted)
        found.update(zip((case.name for case in wanted), made, strict=True))
    return found


def _answer(case: Case, folder: Path, run: Path) -> Any:
    folder.mkdir()
    logs = [log.write(folder, f"log{number}") for number, log in enumerate(case.logs)]
    answer = folder / "answer.json"
    words = [*case.command(logs, run), "--json", str(answer), "--page", str(folder / "page.html")]
    code = _call(words, folder, case.name)
    text = answer.read_text().replace(str(folder.parent), "")
    return {"exit": code, "answer": _stripped(json.loads(text))}


def _call(words: list[str], folder: Path, name: str) -> int:
    begun = time.perf_counter()
    threads = {"OMP_NUM_THREADS": "1"}
    paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [*COMMAND, *words],
        cwd=folder,
        env={**os.environ, **threads, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=False,
    )
    print(
        f"{name}: exit code {done.returncode} after {time.perf_counter() - begun:.0f} s", flush=True
    )
    if done.returncode not in FINE:
        raise SystemExit(f"{' '.join(words)}\n{done.stdout}\n{done.stderr}")
    return done.returncode


def _stripped(value: Any) -> Any:
    """The answer without fields that depend on the clock."""
    if isinstance(value, dict):
        return {k: _stripped(v) for k, v in value.items() if k not in DROPPED}
    return [_stripped(v) for v in value] if isinstance(value, list) else value


if __name__ == "__main__":
    sys.exit(main())
