"""Logs with faults that leave no gap and no wrong cell, imported: what becomes of each, and of clean ones.

    python -m benchmarks.imports --logs 200

Simulated recordings of four robots get markers or bodies that are exchanged, in single rows or for a time,
rows that are frozen or held, or another frame. A log is *silent* where a sample under a wrong name, or an old
one, is stored, or a wrong frame is taken without a word. As many logs are left clean, to count false alarms.
"""

from __future__ import annotations

import argparse
import csv
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from flywheel.data.recordings import RecordingMap, read_recording
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Robot, load_robot, read_robot
from flywheel.truth_simulator.measurement import Measurement
from flywheel.truth_simulator.recording import HiddenRecording, record

Outcome = Literal["put right", "masked", "noted", "error", "SILENT", "clean", "FALSE ALARM"]
OUTCOMES: tuple[Outcome, ...] = ("put right", "masked", "noted", "error", "SILENT")
MOTIONS = 6  # simulated for each robot; noise and faults are new in each log
SECONDS = 6.0
SCRIPTS = ("random_steps", "slow_sine", "gait")
ALARMS = {
    "repeat",
    "swap",
    "leap",
    "rod length",
    "cable",
    "clock",
}  # kinds of findings that a clean log has not
SAME = 1e-9  # [m]
# Height of another frame that is not told apart from the ground, in lengths of the robot.
FLAT = 0.03

BEAM = """
    <body name="beam{0}" pos="0 {1} 1">
      <freejoint/>
      <geom type="cylinder" fromto="-0.5 0 0 0.5 0 0" size="0.03" mass="5"/>
      <site name="left_end{0}" pos="-0.5 0 0"/>
      <site name="right_end{0}" pos="0.5 0 0"/>
    </body>
    <site name="left_anchor{0}" pos="-1 {1} 2.5"/>
    <site name="right_anchor{0}" pos="1 {1} 2.5"/>"""
CABLE = """
    <spatial name="{1}_cable{0}"><site site="{1}_anchor{0}"/><site site="{1}_end{0}"/></spatial>"""
WINCH = """
    <general name="{1}_winch{0}" tendon="{1}_cable{0}" dyntype="integrator" ctrllimited="true"
      ctrlrange="-0.2 0.2" actlimited="true" actrange="0.8 2.4" gainprm="2000" biastype="affine"
      biasprm="0 -2000 -50" forcelimited="true" forcerange="-500 0"/>"""
SENSOR = """
    <framepos name="{1}{0}" objtype="site" objname="{1}_end{0}"/>"""


def hanging(beams: int) -> Robot:
    """Equal beams, each on two cables, a metre apart."""
    names = "ABCD"[:beams]
    ends = [(name, side) for name in names for side in ("left", "right")]
    qpos = " ".join(f"0 {i - (beams - 1) / 2} 1 1 0 0 0" for i in range(beams))
    return read_robot(
        f"""<mujoco model="beams{beams}">
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>{"".join(BEAM.format(name, i - (beams - 1) / 2) for i, name in enumerate(names))}
  </worldbody>
  <tendon>{"".join(CABLE.format(*end) for end in ends)}
  </tendon>
  <actuator>{"".join(WINCH.format(*end) for end in ends)}
  </actuator>
  <sensor>{"".join(SENSOR.format(*end) for end in ends)}
  </sensor>
  <keyframe>
    <key name="hanging" qpos="{qpos}" act="{" ".join(["1.5682"] * len(ends))}"/>
  </keyframe>
</mujoco>"""
    )


ROBOTS: dict[str, Callable[[], Robot]] = {
    "prism3": lambda: load_robot("prism3"),
    "platform4": lambda: load_robot("platform4"),
    "beam": lambda: hanging(1),
    "beams": lambda: hanging(3),
}


@cache
def robot_of(name: str) -> Robot:
    """A robot by its name here."""
    return ROBOTS[name]()


@cache
def motion(name: str, number: int) -> HiddenRecording:
    """One of the motions of a robot."""
    script = SCRIPTS[number % len(SCRIPTS)]
    settings = Measurement(winch_noise=0.001)
    return record(
        robot_of(name), script_name=script, seconds=SECONDS, seed=number, measurement=settings
    )


@dataclass
class Spoilt:
    """A log with a fault.

    Attributes:
      points: (N, P, 3) as logged [m].
      right: (N, P, 3) what they should be, NaN where a sample is none [m].
      frame: all of it is in another frame.
    """

    points: Floats
    right: Floats
    frame: bool = False


def flips(points: Floats, robot: Robot, rng: np.random.Generator) -> Spoilt:
    """Two or three markers are exchanged in rows at random, whichever body they are on."""
    found, count = points.copy(), points.shape[1]
    some = rng.choice(count, min(count, int(rng.integers(2, 4))), replace=False)
    rows = np.flatnonzero(rng.random(len(points)) < rng.uniform(0.02, 0.98))
    for row in rows:
        found[row, some] = points[row, np.roll(some, int(rng.integers(1, len(some))))]
    return Spoilt(found, points)


def swaps(points: Floats, robot: Robot, rng: np.random.Generator) -> Spoilt:
    """Two or three bodies, or two markers where there is one body, are exchanged for one or several times."""
    found, bodies = points.copy(), [body.points for body in robot.bodies if body.points]
    for _ in range(int(rng.integers(1, 4))):
        if len(bodies) > 1:
            some = rng.choice(len(bodies), int(rng.integers(2, len(bodies) + 1)), replace=False)
            there = [i for body in some for i in bodies[body]]
            here = [i for body in np.roll(some, 1) for i in bodies[body]]
        else:
            there = list(rng.choice(points.shape[1], 2, replace=False))
            here = there[::-1]
        begin, end = sorted(rng.choice(len(points), 2, replace=False))
        place = rng.integers(4)
        rows = slice(0 if place == 0 else begin, None if place == 1 else end)
        found[rows, there] = found[rows, here]
    return Spoilt(found, points)


def frozen(points: Floats, robot: Robot, rng: np.random.Generator) -> Spoilt:
    """One, some or all markers repeat a sample for a while, once or several times."""
    found, right, count = points.copy(), points.copy(), points.shape[1]
    for _ in range(int(rng.integers(1, 4))):
        some = rng.choice(
            count, int(rng.choice([1, count, rng.integers(1, count + 1)])), replace=False
        )
        begin = int(rng.integers(0, len(points) - 5))
        end = begin + int(rng.integers(5, 150))
        if np.isnan(right[max(0, begin - 1) : end + 1, some]).any():
            continue  # a time that ends while another lasts would begin with an old sample
        found[begin:end, some] = found[begin, some]
        right[begin + 1 : end, some] = np.nan
    return Spoilt(found, right)


def held(points: Floats, robot: Robot, rng: np.random.Generator) -> Spoilt:
    """A slower tracker, also one whose rate does not divide the log's, some samples being lost."""
    every = rng.choice([2.0, 3.0, 4.0, 5.0, 8.0, 10.0, 100 / 30, 100 / 60, 100 / 24])
    index = np.arange(len(points))
    _, first, tick = np.unique(
        (index / every + 1e-9).astype(int), return_index=True, return_inverse=True
    )
    new = first[tick]
    found, right = points[new], points.copy()
    right[new != index] = np.nan
    lost = (rng.random(points.shape[:2]) < rng.choice([0.0, 0.1]))[new]  # by the tracker
    found[lost], right[lost] = np.nan, np.nan
    return Spoilt(found, right)


def frames(points: Floats, robot: Robot, rng: np.random.Generator) -> Spoilt:
    """Other axes, mirrored ones among them, or an origin elsewhere."""
    if rng.random() < 0.5:
        away = rng.standard_normal(3)
        away *= rng.uniform(0.4, 3.0) * max(1.0, robot.length / 2) / np.linalg.norm(away)
        return Spoilt(points + away, points, frame=True)
    axes, signs = rng.permutation(3), rng.choice([-1.0, 1.0], 3)
    return Spoilt(points[..., axes] * signs, points, frame=True)


FAULTS = {each.__name__: each for each in (flips, swaps, frozen, held, frames)}


def outcome(
    spoilt: Spoilt | None, clean: Floats, made: HiddenRecording, robot: Robot, folder: Path
) -> tuple[Outcome, str]:
    """Outcome of the import of a log, and the first words about it."""
    points = clean if spoilt is None else spoilt.points
    path = folder / "log.csv"
    _write(path, points, made, robot)
    try:
        read = read_recording(path, robot, how=RecordingMap())
    except DataError as error:
        return ("error" if spoilt else "FALSE ALARM"), str(error)
    found = [f for f in read.report.findings if f.kind in ALARMS]
    words = "; ".join(f"{f.kind} {f.subject} {f.action} {f.count}" for f in found)
    if spoilt is None:
        return ("FALSE ALARM" if found else "clean"), words
    if spoilt.frame:
        said = any(f.kind in ("cable", "height") for f in read.report.findings)
        return ("noted" if said else "SILENT"), words
    got = np.concatenate([e.trajectory.observations.points for e in read.episodes])
    kept = np.isfinite(got[..., 0])
    off = np.nan_to_num(np.abs(got - spoilt.right).max(axis=-1), nan=np.inf)
    if (off[kept] > SAME).any():
        return "SILENT", f"{(off[kept] > SAME).sum()} of {kept.sum()} samples; {words}"
    whole = (kept == np.isfinite(spoilt.right[..., 0])).all() and np.isfinite(spoilt.right).all()
    return ("put right" if whole else "masked"), words


def harmless(spoilt: Spoilt, robot: Robot) -> bool:
    """A frame that changes nothing: the robot may as well be there, or is the same seen in a mirror."""
    if not spoilt.frame or robot.tethered:
        return False
    off = spoilt.points[..., 2] - spoilt.right[..., 2]
    return bool(np.abs(off).max() < FLAT * robot.length)


def _write(path: Path, points: Floats, made: HiddenRecording, robot: Robot) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        axes = [f"{point.name}.{axis}" for point in robot.points for axis in "xyz"]
        sensors = [(i, w.sensor) for i, w in enumerate(robot.winches) if w.sensor]
        names = [f"ctrl.{winch.name}" for winch in robot.winches]
        writer.writerow(["time", *names, *axes, *(name for _, name in sensors)])
        blank = np.full((1, made.controls.shape[1]), np.nan)
        commands = np.concatenate([made.controls, blank])
        winch = made.winch[:, [i for i, _ in sensors]]
        rows = np.concatenate(
            [made.time[:, None], commands, points.reshape(len(points), -1), winch], axis=1
        )
        writer.writerows([repr(x) if np.isfinite(x) else "" for x in row] for row in rows.tolist())


def draw(kind: str, number: int, seed: int) -> tuple[str, Outcome, str]:
    """The robot, outcome and words of one log with a fault of some kind, or "" for none."""
    rng = np.random.default_rng([seed, number, *kind.encode()])
    while True:
        name = str(rng.choice(list(ROBOTS)))
        robot, made = robot_of(name), motion(name, int(rng.integers(MOTIONS)))
        noise = robot.length * rng.choice([0.0003, 0.001, 0.003])
        clean = made.true_points + noise * rng.standard_normal(made.true_points.shape)
        digits = int(rng.choice([4, 5, 6, 16]))
        clean = np.round(clean, digits)
        spoilt = FAULTS[kind](clean, robot, rng) if kind else None
        if spoilt is None or not harmless(spoilt, robot):
            break
    with TemporaryDirectory(prefix="imports-") as folder:
        return name, *outcome(spoilt, clean, made, robot, Path(folder))


def _count(kinds: Sequence[str], logs: int, seed: int, counts: dict[str, Counter[Outcome]]) -> None:
    for number in range(logs):
        for kind in (kinds[number % len(kinds)], ""):
            name, found, words = draw(kind, number, seed)
            counts.setdefault(kind, Counter())[found] += 1
            if found in ("SILENT", "FALSE ALARM"):
                print(f"{kind or 'clean'} {number} ({name}): {found}: {words[:300]}", flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Count, until Ctrl-C at the latest; the exit code is 1 if a fault was silent or an alarm false."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.imports", description=__doc__)
    parser.add_argument("--logs", type=int, default=200, help="with a fault, and as many without")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", default=",".join(FAULTS), help="of faults")
    asked = parser.parse_args(arguments)
    counts: dict[str, Counter[Outcome]] = {"": Counter()}
    with suppress(KeyboardInterrupt):  # the counts so far are shown
        _count(asked.kinds.split(","), asked.logs, asked.seed, counts)
    alarms = counts.pop("")
    print("| fault | logs |" + "".join(f" {each} |" for each in OUTCOMES))
    print("|---|---|" + "---|" * len(OUTCOMES))
    for kind, count in counts.items():
        cells = [count.total(), *(count[each] for each in OUTCOMES)]
        print(f"| {kind} | " + " | ".join(map(str, cells)) + " |")
    print(f"Clean logs: {alarms.total()}, false alarms: {alarms['FALSE ALARM']}.")
    return int(alarms["FALSE ALARM"] > 0 or any(each["SILENT"] for each in counts.values()))


if __name__ == "__main__":
    raise SystemExit(main())
