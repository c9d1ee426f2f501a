"""The worst window of a plant as a video: before and after the diagnosis, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flywheel.diagnosis import Diagnosis
from flywheel.dynamics.plant import Film, Reckoning, Shot, states_of, write_video
from flywheel.effects import Scales
from flywheel.records import Floats, Trajectory
from flywheel.reports.comparison_video import FPS, SLOWER
from flywheel.robots import Robot
from flywheel.smoothing import savitzky_golay

SHOT = Shot(size=(640, 368), distance=1.5)
MAGNIFIED = (1, 2, 5)  # times that a difference may be drawn as large as it is
# Length of the parabolas that take noise out; longer ones round impacts off [sqrt(L / g)].
SMOOTHED = 0.2
FARTHEST = 0.25  # that a point may then seem to be off, as a share of the robot's length


@dataclass(frozen=True)
class WorstWindow:
    """The worst window of the initial plant, for drawing; T steps.

    Attributes:
      robot: to draw.
      dt: control step [s].
      recording: number of the recording, from 0.
      begin, end: of the window in the recording [s].
      measured: (T, P, 3) points without noise [m].
      predicted: (T, P, 3) by the initial plant, and if something was found, by the one with the
        first answer [m].
      winch: (T, W) best known positions [m].
      times: magnification of differences in the drawing.
    """

    robot: Robot
    dt: float
    recording: int
    begin: float
    end: float
    measured: Floats
    predicted: tuple[Floats, ...]
    winch: Floats
    times: int

    @classmethod
    def of(cls, found: Diagnosis, robot: Robot, recordings: Sequence[Trajectory]) -> WorstWindow:
        """Find the window.

        Args:
          found: the diagnosis.
          robot: of the diagnosis.
          recordings: that were fitted.
        """
        evidence, dt = found.evidence, found.evidence.dt
        window = int(np.nanargmax(np.nanmean(evidence.squares(evidence.before), axis=1)))
        number, first = int(evidence.recording[window]), int(evidence.first[window])
        rows = slice(first, first + evidence.measured.shape[1])
        recording = recordings[number]
        smooth, _ = savitzky_golay(
            recording.observations.points, dt, SMOOTHED * Scales.of(robot).time
        )
        before, after = evidence.before[window], evidence.after[window]
        return cls(
            robot=robot,
            dt=dt,
            recording=number,
            begin=dt * rows.start,
            end=dt * (rows.stop - 1),
            measured=smooth[rows],
            predicted=(before, after) if any(found.answers) else (before,),
            winch=Reckoning(robot, dt).known(recording)[rows],
            times=_times(smooth[rows] - before, robot),
        )

    def film(self, path: Path) -> Path:
        """Film it, the predictions side by side.

        Args:
          path: of the mp4.

        Raises:
          Exception: any error of a graphics driver without rendering.
        """
        films = [self._frames(points) for points in self.predicted]
        rows = (np.concatenate(parts, axis=1) for parts in zip(*films, strict=True))
        width, height = SHOT.size
        return write_video(rows, path, (len(films) * width, height), FPS)

    def _frames(self, points: Floats) -> list[np.ndarray]:
        states = states_of(self.robot, self.dt, points, self.winch)
        ghosts = points + self.times * (self.measured - points)
        dt = SLOWER * self.dt
        film = Film(self.robot, states, fps=FPS, ghosts=ghosts, dt=dt, shot=SHOT)
        return list(film.frames())


def _times(off: Floats, robot: Robot) -> int:
    """Magnification of differences (T, P, 3) in the drawing, within the available room."""
    room = FARTHEST * robot.length / max(float(np.linalg.norm(off, axis=-1).max()), 1e-9)
    return max((each for each in MAGNIFIED if each <= room), default=1)
