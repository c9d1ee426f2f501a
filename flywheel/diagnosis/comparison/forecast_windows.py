"""Recordings tiled by windows, each predicted from the measured past before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from flywheel.diagnosis.fitting.subject import Subject
from flywheel.dynamics.plant import Reckoning, RestartedPlant
from flywheel.effects import Scales, Terms
from flywheel.errors import DataError
from flywheel.evaluation import past_at, places
from flywheel.evaluation.pasts import stacked
from flywheel.noise import noise_floor
from flywheel.records import RECORDING, Episode, Floats, Observation, Past, Provenance, Trajectory
from flywheel.robots import Robot
from flywheel.smoothing import savitzky_golay

FEWEST_STEPS = 5  # of a window
WARMUP = 0.55  # that a model moves by itself before it is taken for the truth [sqrt(L / g)]
SMOOTHED = 0.3  # length of the parabolas that smooth measured positions [sqrt(L / g)]


@dataclass(frozen=True)
class ForecastWindows:
    """K windows of equal length; each starts with all points in sight.

    Attributes:
      robot: of the recordings.
      recordings: as episodes.
      names: of the recordings.
      steps: of each window.
      warmup: steps before each window in which a model can forget its start.
      lead: steps before each window that belong to its past, including the warm-up.
      recording: (K,) index of each window's recording.
      first: (K,) step of the recording that is its present.
      sigma: noise of each measured coordinate [m].
      begun: (recordings, W) fitted positions of the winches in the first rows, see
        `with_first_lengths`; None if they were measured [m].
    """

    robot: Robot
    recordings: tuple[Episode, ...]
    names: tuple[str, ...]
    steps: int
    warmup: int
    lead: int
    recording: np.ndarray
    first: np.ndarray
    sigma: float
    begun: Floats | None = None
    # Winch positions, once for all parts of the windows, by what they were reckoned with.
    _reckoned: dict[tuple[object, ...], tuple[Floats, ...]] = field(
        default_factory=dict, repr=False, compare=False
    )

    @classmethod
    def cut(
        cls,
        robot: Robot,
        recordings: Sequence[Trajectory],
        seconds: float,
        history: int,
        names: Sequence[str] = (),
    ) -> ForecastWindows:
        """Tile recordings.

        Args:
          robot: of the recordings.
          recordings: unbatched, of one control step.
          seconds: of a window; the longest possible if no recording is as long.
          history: past steps of the models.
          names: of the recordings; numbers by default.

        Raises:
          DataError: recordings cannot be used, or are too short.
        """
        _check(robot, recordings)
        dt = recordings[0].dt
        warmup = max(history, round(WARMUP * Scales.of(robot).time / dt))
        lead = warmup + history
        longest = max(t.steps for t in recordings) - lead
        steps = min(round(seconds / dt), longest)
        if steps < FEWEST_STEPS:
            raise DataError(
                f"Windows need {FEWEST_STEPS} steps of {dt:g} s after a past of {lead} steps; asked for "
                f"{seconds:g} s, and the longest recording has {longest + lead} steps in all."
            )
        about = Provenance(robot.digest, source=RECORDING, dataset=RECORDING)
        episodes = tuple(
            Episode(f"recording-{i}", t, about, "test") for i, t in enumerate(recordings)
        )
        found = [(i, f) for i, e in enumerate(episodes) for f in _tiled(e, steps, lead)]
        if not found:
            raise DataError(
                f"No recording has {steps * dt:g} s from where all points are in sight; see that markers "
                "are not lost, or ask for a shorter horizon."
            )
        return cls(
            robot=robot,
            recordings=episodes,
            names=tuple(names) or tuple(f"recording {i}" for i in range(len(episodes))),
            steps=steps,
            warmup=warmup,
            lead=lead,
            recording=np.array([i for i, _ in found]),
            first=np.array([f for _, f in found]),
            sigma=noise_floor([t.observations.points for t in recordings]),
        )

    def __len__(self) -> int:
        return len(self.recording)

    def __getitem__(self, some: slice) -> ForecastWindows:
        """Some of the windows."""
        return replace(self, recording=self.recording[some], first=self.first[some])

    def starting_at(self, begun: Floats) -> ForecastWindows:
        """The same, with winches at (recordings, W) in the first rows [m]."""
        return replace(self, begun=begun, _reckoned={})

    @property
    def winches_measured(self) -> bool:
        """Every winch was measured in the first row of each recording."""
        return all(np.isfinite(e.trajectory.observations.winch[0]).all() for e in self.recordings)

    @property
    def moved(self) -> Floats:
        """(W,) largest fitted distance of first winch positions from the keyframe; 0 if measured [m]."""
        home = self.robot.winch_of(self.robot.keyframe)
        measured = np.stack([e.trajectory.observations.winch[0] for e in self.recordings])
        if self.begun is None:
            return np.zeros_like(home)
        off = np.where(np.isfinite(measured), 0.0, np.abs(self.begun - home))
        return np.asarray(off[sorted(set(self.recording.tolist()))].max(axis=0))

    @property
    def dt(self) -> float:
        """Control step [s]."""
        return self.recordings[0].trajectory.dt

    @property
    def unused(self) -> tuple[str, ...]:
        """Names of the recordings without a window."""
        used = set(self.recording)
        return tuple(name for i, name in enumerate(self.names) if i not in used)

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each window."""
        begin = self.dt * self.first
        end = begin + self.dt * self.steps
        return tuple(
            f"{self.names[i]}, {b:.2f} to {e:.2f} s"
            for i, b, e in zip(self.recording, begin, end, strict=True)
        )

    @cached_property
    def measured(self) -> Floats:
        """(K, steps, P, 3) targets; NaN where missing [m]."""
        return self.ahead([e.trajectory.observations.points for e in self.recordings])

    @cached_property
    def winch(self) -> tuple[Floats, ...]:
        """(T + 1, W) positions of nominal winches in each recording: measured, or dead-reckoned [m]."""
        return self._winches(())

    @cached_property
    def smooth(self) -> tuple[tuple[Floats, Floats], ...]:
        """(T + 1, P, 3) positions [m] and velocities [m/s] in each recording, without noise or gaps."""
        seconds = SMOOTHED * Scales.of(self.robot).time
        points = [e.trajectory.observations.points for e in self.recordings]
        return tuple(savitzky_golay(each, self.dt, seconds) for each in points)

    def controls(self, before: int = 0) -> Floats:
        """(K, before + steps, W) commands from some steps before the windows to their ends."""
        return self._ahead([e.trajectory.controls for e in self.recordings], -before, 0)

    def before(self, series: Sequence[Floats]) -> Floats:
        """(K, steps, ...) of (T + 1, ...) for each recording, at the start of each control."""
        return self._ahead(series, 0, 0)

    def ahead(self, series: Sequence[Floats]) -> Floats:
        """The same one step later, at the predicted instants."""
        return self._ahead(series, 1, 1)

    def past(self, subject: Subject) -> Past:
        """(K,) measured pasts, as model inputs."""
        return self._pasts(subject, self.recordings, self.first)

    def origin(self, subject: Subject) -> Past:
        """(K,) pasts before the windows and their warm-up, of smoothed measurements."""
        return self._pasts(subject, self._smooth_episodes, self.first - self.warmup)

    def _pasts(self, subject: Subject, episodes: Sequence[Episode], first: np.ndarray) -> Past:
        model = subject.dynamics
        history, told = model.history, not isinstance(model, RestartedPlant)
        winch = self._winches(subject.terms, told)
        return stacked(
            [
                past_at(episodes[i], self.robot, step, history, winch[i], subject.dataset)
                for i, step in zip(self.recording, first, strict=True)
            ]
        )

    def _winches(self, terms: Terms, told: bool = False) -> tuple[Floats, ...]:
        """(T + 1, W) winch positions in each recording, from the known effects of the plant [m].

        A plant is asked for the tensions; other models are told what these say of the winches.
        """
        key = (told, *((term.effect.name, term.place, term.values) for term in terms))
        if key not in self._reckoned:
            reckoning = Reckoning(self.robot, self.dt, terms)
            tracks = self.tracks if told else [replace(t, channels=()) for t in self.tracks]
            self._reckoned[key] = tuple(reckoning.known(track) for track in tracks)
        return self._reckoned[key]

    @property
    def tracks(self) -> list[Trajectory]:
        """The recordings, with the winches' fitted positions in their first rows."""
        tracks = [episode.trajectory for episode in self.recordings]
        if self.begun is None:
            return tracks
        winches = [track.observations.winch.copy() for track in tracks]
        for winch, begun in zip(winches, self.begun, strict=True):
            winch[0] = begun
        return [
            replace(track, observations=replace(track.observations, winch=winch))
            for track, winch in zip(tracks, winches, strict=True)
        ]

    @cached_property
    def _smooth_episodes(self) -> tuple[Episode, ...]:
        made = []
        for episode, (points, _) in zip(self.recordings, self.smooth, strict=True):
            t = episode.trajectory
            seen = Observation(points, t.observations.winch)
            made.append(
                Episode(episode.id, Trajectory(seen, t.controls, t.dt), episode.provenance, "test")
            )
        return tuple(made)

    def _ahead(self, series: Sequence[Floats], begin: int, end: int) -> Floats:
        return np.stack(
            [
                series[i][first + begin : first + self.steps + end]
                for i, first in zip(self.recording, self.first, strict=True)
            ]
        )


def _tiled(episode: Episode, steps: int, lead: int) -> list[int]:
    """Starts of windows of so many steps, one right after the other."""
    if episode.trajectory.steps < lead + steps:
        return []
    found, free = [], lead
    for place in places(episode, steps, lead):
        if place >= free:
            found.append(int(place))
            free = place + steps
    return found


def _check(robot: Robot, recordings: Sequence[Trajectory]) -> None:
    if not recordings:
        raise DataError("There is no recording to compare with.")
    if len(rates := sorted({round(t.dt, 9) for t in recordings})) > 1:
        raise DataError(f"Recordings need one control step, got {rates} s.")
    wanted = (len(robot.points), len(robot.winches))
    for number, t in enumerate(recordings):
        got = (t.observations.points.shape[-2], t.controls.shape[-1])
        if got != wanted:
            raise DataError(
                f"Recording {number} has (points, winches) = {got}; robot {robot.name} has {wanted}."
            )
