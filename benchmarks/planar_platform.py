"""A real cable robot: a public log of a planar platform on four cables, diagnosed.

    git clone https://github.com/gchenfc/cable-robot CHECKOUT
    python -m benchmarks.planar_platform CHECKOUT FOLDER
    cd FOLDER
    flywheel diagnose monday.csv tuesday.csv --held-out friday.csv --robot planar4.xml

The log has no licence, so that it is read where it is and not copied into this project. Motion capture gives
the markers at 120 Hz, the controller the lengths that it took its cables to have at 100 Hz. Their clocks are
aligned by what both have seen: lengths of cables, each up to a factor and an offset (the factor is the answer
that a diagnosis has to find). An MJCF is made of what the log itself says: corners of the frame, shape of the
platform; stiffness, damping and mass are guesses. The winches are told what the controller took for lengths,
so that one whose drum is smaller than it thinks has a gain below one.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from benchmarks.command import parser_of
from benchmarks.logs import write_log
from flywheel.records import Floats
from flywheel.robots import read_robot

TAKE = "analysis/gerry00_estimation/13_concentric_diamonds_1mps_cal"
FRAME, MARKERS = ("br", "tr", "tl", "bl"), ("m1", "m2", "m3", "m4")
SIDES = np.array([[1, 0, -1], [1, 0, 1], [-1, 0, 1], [-1, 0, -1]])  # of the frame's corners
BEYOND = 0.026  # that a cable ends beside the marker at its corner [m]
DT = 0.01  # of the controller's log [s]
OFFSETS = np.arange(-8.0, 8.0, 0.05)  # between the clocks, tried [s]
STIFFNESS, DAMPING, MASS = 2e4, 200.0, 1.0  # guessed [N/m, N s/m, kg]
LOGS = {"monday": (1.0, 7.0), "tuesday": (8.0, 3.0), "friday": (12.0, 4.0)}  # begin, length [s]


@dataclass(frozen=True)
class Take:
    """The measurements: x along the frame, y out of its plane, z up.

    There are T frames of the motion capture, and S rows of the controller's log.

    Attributes:
      time: (T,) of the motion capture [s].
      markers: (T, 4, 3) of the platform [m]; NaN if not visible.
      corners: (4, 3) of the frame, in the order of the controller's cables [m].
      told: (S, 4) cable lengths assumed by the controller [m].
    """

    time: Floats
    markers: Floats
    corners: Floats
    told: Floats

    @classmethod
    def read(cls, checkout: Path) -> Take:
        """From a checkout of the repository."""
        path = checkout / TAKE
        with path.with_suffix(".csv").open() as lines:
            rows = [row for row, _ in zip(csv.reader(lines), range(7), strict=False)]
        names, kinds, axes = rows[3], rows[5], rows[6]
        table = np.genfromtxt(path.with_suffix(".csv"), delimiter=",", skip_header=7)
        heads = list(zip(names, kinds, axes, strict=True))

        def points(name: str) -> Floats:
            """(T, 3) of a marker; the file's z lies along the frame, its y is up."""
            return np.asarray(table[:, [heads.index((name, "Position", axis)) for axis in "ZXY"]])

        platform = np.stack([points(f"Rigid Body 2_{k}") for k in range(1, 5)], axis=1)
        frame = np.array(
            [np.nanmean(points(n), axis=0) for n in sorted(set(names)) if "Marker_" in n]
        )
        beside = frame - frame.mean(axis=0)
        corners = np.array([frame[(beside @ side).argmax()] for side in SIDES])
        log = np.loadtxt(path.with_suffix(".txt"), comments="S", usecols=(9, 14, 19, 24))
        return cls(table[:, 1], platform, corners, -log)


@dataclass(frozen=True)
class Platform:
    """A rigid body with markers, and the ends of four cables.

    Attributes:
      shape: (4, 3) markers beside their mean [m].
      ends: (4, 3) of the cables [m].
    """

    shape: Floats
    ends: Floats

    @classmethod
    def of(cls, take: Take) -> Platform:
        """Its shape is the mean one; cables end beside the markers, in the plane of the frame."""
        seen = take.markers[np.isfinite(take.markers).all(axis=(1, 2))]
        beside = seen - seen.mean(axis=1, keepdims=True)
        turns = [Rotation.align_vectors(beside[0], each)[0] for each in beside[::40]]
        shape = np.mean(
            [turn.apply(each) for turn, each in zip(turns, beside[::40], strict=True)], axis=0
        )
        corners = shape[[(shape @ side).argmax() for side in SIDES]]
        across = corners - corners[[3, 2, 1, 0]]
        ends = corners + BEYOND * across / np.linalg.norm(across, axis=1, keepdims=True)
        ends[:, 1] = take.corners[:, 1].mean() - seen[..., 1].mean()
        return cls(shape, ends)

    def lengths(self, markers: Floats, corners: Floats) -> Floats:
        """(4,) of the cables, from markers (4, 3) to the frame's corners [m]."""
        middle = markers.mean(axis=0)
        turn, _ = Rotation.align_vectors(markers - middle, self.shape)
        return np.asarray(np.linalg.norm(turn.apply(self.ends) + middle - corners, axis=1))


def clock_offset(take: Take, lengths: Floats) -> tuple[float, Floats]:
    """Correction of the log's time [s], and (4,) factors of the controller's lengths.

    Args:
      take: both logs.
      lengths: (T, 4) of the cables by the motion capture [m]; NaN if not visible.
    """
    seen, time = np.isfinite(lengths).all(axis=1), np.arange(len(take.told)) * DT

    def fitted(offset: float) -> tuple[float, list[Floats]]:
        both = (time + offset > take.time[0]) & (time + offset < take.time[-1])
        square, factors = 0.0, []
        for cable in range(4):
            true = np.interp(time[both] + offset, take.time[seen], lengths[seen, cable])
            known = np.stack([take.told[both, cable], np.ones(both.sum())], axis=1)
            factor, *_ = np.linalg.lstsq(known, true, rcond=None)
            square += float(np.mean((known @ factor - true) ** 2))
            factors.append(factor[0])
        return square, factors

    best = min(OFFSETS, key=lambda each: fitted(each)[0])
    offset = float(minimize_scalar(lambda x: fitted(x)[0], (best - 0.05, best, best + 0.05)).x)
    return offset, np.array(fitted(offset)[1])


def mjcf(platform: Platform, corners: Floats, start: Floats) -> str:
    """The robot: a free body between four corners, with its markers' mean at `start` (3,) [m]."""

    def written(values: Floats) -> str:
        return " ".join(f"{value:.5f}" for value in values)

    rest = np.linalg.norm(start + platform.ends - corners, axis=1)
    gain = f'gainprm="{STIFFNESS:g}" biastype="affine" biasprm="0 -{STIFFNESS:g} -{DAMPING:g}"'
    limits = 'ctrlrange="-2 2" actlimited="true" actrange="0.2 3.5" forcerange="-2000 0"'
    anchors = [
        f'<site name="anchor_{n}" pos="{written(c)}"/>' for n, c in zip(FRAME, corners, strict=True)
    ]
    ends = [
        f'<site name="end_{n}" pos="{written(e)}"/>'
        for n, e in zip(FRAME, platform.ends, strict=True)
    ]
    markers = [
        f'<site name="on_{m}" pos="{written(p)}"/>'
        for m, p in zip(MARKERS, platform.shape, strict=True)
    ]
    cables = [
        f'<spatial name="cable_{n}"><site site="anchor_{n}"/><site site="end_{n}"/></spatial>'
        for n in FRAME
    ]
    winches = [
        f'<general name="winch_{n}" tendon="cable_{n}" dyntype="integrator" {gain} {limits}/>'
        for n in FRAME
    ]
    seen = [f'<framepos name="{m}" objtype="site" objname="on_{m}"/>' for m in MARKERS]
    seen += [
        f'<user name="position_{n}" objtype="actuator" objname="winch_{n}" dim="1"/>' for n in FRAME
    ]
    deck = f'<geom type="box" size="0.09 0.03 0.06" mass="{MASS:g}" pos="0 {platform.ends[0, 1]:.4f} 0"/>'
    body = f'<body name="platform" pos="{written(start)}"><joint name="platform" type="free" damping="0.5"/>'
    key = (
        f'<key name="start" act="{written(rest)}" ctrl="0 0 0 0" qpos="{written(start)} 1 0 0 0"/>'
    )
    parts = [
        '<mujoco model="planar4"><option timestep="0.005" integrator="implicitfast"/><worldbody>',
        '<geom type="plane" size="0 0 1" pos="0 0 -0.5"/>',
        *anchors,
        *(body, deck, *ends, *markers, "</body></worldbody>"),
        *(
            "<tendon>",
            *cables,
            "</tendon><actuator>",
            *winches,
            "</actuator><sensor>",
            *seen,
            "</sensor>",
        ),
        f"<keyframe>{key}</keyframe></mujoco>",
    ]
    return "\n".join(parts) + "\n"


def main() -> None:
    """Write the robot and its logs."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("checkout", type=Path)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    take = Take.read(given.checkout)
    platform = Platform.of(take)
    seen = np.isfinite(take.markers).all(axis=(1, 2))
    lengths = np.full((len(take.time), 4), np.nan)
    lengths[seen] = [platform.lengths(each, take.corners) for each in take.markers[seen]]
    offset, factors = clock_offset(take, lengths)
    off = ", ".join(f"{factor - 1.0:+.1%}" for factor in factors)
    print(f"The log is {offset:.3f} s behind; lengths of its cables are off by {off}.")
    given.folder.mkdir(parents=True, exist_ok=True)
    start = take.markers[seen][:100].mean(axis=(0, 1))
    model = mjcf(platform, take.corners, start)
    (given.folder / "planar4.xml").write_text(model)
    robot = read_robot(model)
    at = np.arange(len(take.told)) * DT + offset
    flat = take.markers[seen].reshape(-1, 12)
    markers = np.stack(
        [np.interp(at, take.time[seen], column) for column in flat.T], axis=1
    ).reshape(-1, 4, 3)
    rates = np.diff(take.told, axis=0) / DT
    moved = int((np.abs(rates).max(axis=1) > 0.05).argmax())
    for name, (begin, seconds) in LOGS.items():
        first, steps = moved + round(begin / DT), round(seconds / DT)
        rows = markers[first : first + steps + 1]
        start_lengths = platform.lengths(rows[0], take.corners)
        told = rates[first : first + steps]
        write_log(given.folder / f"{name}.csv", rows, told, start_lengths, DT, robot)


if __name__ == "__main__":
    main()
