"""Real servo motors: a public log of a trunk on twelve tendons, whose six motors are diagnosed.

    git clone https://github.com/StanfordASL/trunk-stack CHECKOUT
    python -m benchmarks.trunk_servos CHECKOUT/stack/main/data/trajectories/dynamic/servo_motor_archive FOLDER
    cd FOLDER
    flywheel diagnose monday.csv tuesday.csv --held-out friday.csv --robot servos.xml --noise 0.00016

The log (MIT licence) has the angles that the motors were told and those that they had, at 100 Hz. The trunk
bends and its tendons pass several discs, which no cable of `flywheel` can. So each motor is looked at by
itself: an MJCF of six weights, each on the cable of one winch, with the measured angle for the height
of its weight. Nothing measures the winches after the first row. A log begins with what the motors were told
before it is measured: late ones are still doing that. What motors lack, a regression of measured
on told angles says, too, which the diagnosis does not see.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from benchmarks.command import parser_of
from benchmarks.logs import write_log
from flywheel.records import Floats
from flywheel.robots import GRAVITY, Robot, read_robot

DT = 0.01  # of the log [s]
MOTORS = 6
DRUM = 0.1  # of all winches: weights fall behind no motor [m]
LENGTH, CEILING, APART = 1.0, 2.0, 0.2  # of a cable at angle 0; of the anchors [m]
# Of a cable and its weight: 16 Hz, half of critical [N/m, N s/m, kg].
STIFFNESS, DAMPING, MASS = 1e4, 100.0, 1.0
# Begin and length of what is measured [s].
LOGS = {"monday": (20.0, 3.0), "tuesday": (60.0, 3.0), "friday": (125.0, 3.0)}
BEFORE = 0.3  # of commands at the beginning of a log without measurements, longer than motors are late [s]
DELAYS = range(41)  # rows of the log
LAGS = np.arange(0.0, 0.11, 0.01)  # time constants [s]


@dataclass(frozen=True)
class ServoLog:
    """Commands and angles of six motors.

    Attributes:
      told: (S, 6) commanded angles, each from one row of `had` to the next [rad].
      had: (S + 1, 6) measured angles [rad].
    """

    told: Floats
    had: Floats

    @classmethod
    def read(cls, folder: Path) -> ServoLog:
        """The longest log, without a load."""
        told = np.loadtxt(folder / "control_inputs_controlled_1.csv", delimiter=",", skiprows=1)
        had = np.loadtxt(folder / "observations_controlled_1.csv", delimiter=",", skiprows=1)
        return cls(np.radians(told[:, 1:]), np.radians(had[:, -MOTORS:]))

    def regression(self) -> tuple[float, float, Floats]:
        """Delay and time constant of a lag [s] that suit all motors best, and (6,) gains."""

        def fitted(delay: int, lag: float) -> tuple[float, Floats]:
            stay = np.exp(-DT / lag) if lag else 0.0
            slow = lfilter([1.0 - stay], [1.0, -stay], self.told, axis=0)
            known, true = slow[: len(slow) - delay], self.had[delay + 1 :]
            known, true = known - known.mean(axis=0), true - true.mean(axis=0)
            gains = (known * true).sum(axis=0) / (known**2).sum(axis=0)
            return float(((known * gains - true) ** 2).mean()), gains

        tried = [(*fitted(delay, lag), delay, lag) for delay in DELAYS for lag in LAGS]
        _, gains, delay, lag = min(tried, key=lambda each: each[0])
        return float(delay * DT), float(lag), gains


def mjcf() -> str:
    """Six weights under a ceiling, each on the cable of a position winch."""
    gain = f'gainprm="{STIFFNESS:g}" biastype="affine" biasprm="0 -{STIFFNESS:g} -{DAMPING:g}"'
    limits = 'ctrlrange="0.2 1.8" forcerange="-1000 0"'
    at = [APART * k for k in range(MOTORS)]
    low = CEILING - LENGTH - MASS * GRAVITY / STIFFNESS
    anchors = [f'<site name="anchor_{k}" pos="{x:g} 0 {CEILING:g}"/>' for k, x in enumerate(at)]
    weights = [
        f'<body name="weight_{k}" pos="{x:g} 0 {low:.6f}"><freejoint name="weight_{k}"/>'
        f'<geom type="sphere" size="0.03" mass="{MASS:g}"/><site name="on_{k}"/></body>'
        for k, x in enumerate(at)
    ]
    cables = [
        f'<spatial name="cable_{k}"><site site="anchor_{k}"/><site site="on_{k}"/></spatial>'
        for k in range(MOTORS)
    ]
    winches = [
        f'<general name="motor_{k}" tendon="cable_{k}" dyntype="filterexact" dynprm="0.001" {gain} {limits}/>'
        for k in range(MOTORS)
    ]
    seen = [f'<framepos name="m{k}" objtype="site" objname="on_{k}"/>' for k in range(MOTORS)]
    told = [
        f'<user name="position_{k}" objtype="actuator" objname="motor_{k}" dim="1"/>'
        for k in range(MOTORS)
    ]
    rest = " ".join([f"{LENGTH:g}"] * MOTORS)
    begin = " ".join(f"{x:g} 0 {low:.6f} 1 0 0 0" for x in at)
    parts = [
        '<mujoco model="servos"><option timestep="0.005" integrator="implicitfast"/><worldbody>',
        *(*anchors, *weights, "</worldbody><tendon>", *cables, "</tendon><actuator>", *winches),
        *("</actuator><sensor>", *seen, *told, "</sensor><keyframe>"),
        f'<key name="start" act="{rest}" ctrl="{rest}" qpos="{begin}"/></keyframe></mujoco>',
    ]
    return "\n".join(parts) + "\n"


def write_servo_log(path: Path, log: ServoLog, robot: Robot) -> None:
    """Write a part of the log, replacing an existing file: cables that lengthen as motors turn."""
    lengths = LENGTH + DRUM * log.had
    heights = CEILING - lengths - MASS * GRAVITY / STIFFNESS
    across = np.broadcast_to(APART * np.arange(MOTORS), heights.shape)
    points = np.stack([across, np.zeros_like(heights), heights], axis=2)
    points[: round(BEFORE / DT)] = np.nan
    write_log(path, points, LENGTH + DRUM * log.told, lengths[0], DT, robot)


def main() -> None:
    """Write the robot and its logs, and print the results of the regression."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("archive", type=Path)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    log = ServoLog.read(given.archive)
    delay, lag, gains = log.regression()
    shown = ", ".join(f"{gain - 1.0:+.0%}" for gain in gains)
    print(f"A delay of {delay:.2f} s, a lag of {lag:.2f} s, and gains that are {shown} off.")
    given.folder.mkdir(parents=True, exist_ok=True)
    (given.folder / "servos.xml").write_text(mjcf())
    robot = read_robot(mjcf())
    for name, (begin, seconds) in LOGS.items():
        first, last = round(begin / DT), round((begin + seconds) / DT)
        begun = first - round(BEFORE / DT)
        part = ServoLog(log.told[begun:last], log.had[begun : last + 1])
        write_servo_log(given.folder / f"{name}.csv", part, robot)


if __name__ == "__main__":
    main()
