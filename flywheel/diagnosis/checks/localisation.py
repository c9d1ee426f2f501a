"""Localisation: time and place of an unexplained error.

Time and tracked point: the maximum of the residual, in pieces of a tenth of a window. Cable: the
one whose change alone would explain most of the residual in that window, by any effect of the
library that acts on single cables.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fitter
from flywheel.diagnosis.selection.scores import ScoreTest
from flywheel.records import Floats

PIECES = 10  # of a window


@dataclass(frozen=True)
class Location:
    """Time and place of the largest part of the residual.

    Attributes:
      cables: (K, C) squares explained by a change of each cable in each window alone [sigma^2].
      recording: index of the one with the largest residual.
      begin, end: interval of time in it [s].
      point: its tracked point, or channel.
      cable: with the best explanation in that window; "" if the library has no effect on cables.
    """

    cables: Floats
    recording: int
    begin: float
    end: float
    point: str
    cable: str

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {
            "recording": self.recording,
            "from": self.begin,
            "to": self.end,
            "unit": "s",
            "point": self.point,
            "cable": self.cable,
        }


def localise(fitter: Fitter, test: ScoreTest) -> Location:
    """Locate the residual of a test's model."""
    windows, robot = fitter.windows, fitter.windows.robot
    cables = _explained(fitter, test)
    in_noise = (windows.sigma / windows.noise) ** 2
    pieces = in_noise * _pieces(fitter, test)  # (K, pieces, P)
    over_points = pieces.mean(axis=2)
    window, piece = (int(i) for i in np.unravel_index(over_points.argmax(), over_points.shape))
    first, last = _run(over_points[window], piece)
    length = windows.steps * windows.dt / pieces.shape[1]
    start = windows.first[window] * windows.dt
    point = int(pieces[window, first : last + 1].mean(axis=0).argmax())
    cable = robot.cables[int(cables[window].argmax())].name if cables.any() else ""
    return Location(
        cables,
        int(windows.recording[window]),
        float(start + first * length),
        float(start + (last + 1) * length),
        windows.names[point],
        cable,
    )


def _explained(fitter: Fitter, test: ScoreTest) -> Floats:
    """(K, C) largest explanation by any effect at each cable in each window."""
    windows = len(fitter.windows)
    left = test.residual.reshape(windows, -1)
    found = np.zeros((windows, len(fitter.windows.robot.cables)))
    for candidate, shapes in zip(test.candidates, test.slices, strict=True):
        if candidate.effect.where != "cable":
            continue
        for columns in shapes:
            part = test.columns[:, columns].reshape(windows, left.shape[1], -1)
            gram = part.swapaxes(1, 2) @ part
            right = np.einsum("kds,kd->ks", part, left)
            explained = np.einsum("ks,kst,kt->k", right, np.linalg.pinv(gram, rcond=1e-9), right)
            found[:, candidate.place] = np.maximum(found[:, candidate.place], explained)
    return found


def _pieces(fitter: Fitter, test: ScoreTest) -> Floats:
    """(K, pieces, P) mean square of the residual, over time, of each tracked point."""
    windows, shape = fitter.windows, fitter.windows.measured.shape
    left = test.left.reshape(shape[0], -1)[:, : int(np.prod(shape[1:]))]
    squares, noisy = windows.squares(left).reshape(shape), windows.noisy
    parts = np.array_split(np.arange(shape[1]), min(PIECES, shape[1]))
    means = [
        squares[:, part].sum(axis=(1, 3)) / np.maximum(noisy[:, part].sum(axis=(1, 3)), 1)
        for part in parts
    ]
    return np.stack(means, axis=1)


def _run(pieces: Floats, highest: int) -> tuple[int, int]:
    """First and last of the adjacent pieces that stand out by half as much as the highest."""
    above = pieces > 1.0 + 0.5 * max(pieces[highest] - 1.0, 0.0)
    first = last = highest
    while first > 0 and above[first - 1]:
        first -= 1
    while last + 1 < len(pieces) and above[last + 1]:
        last += 1
    return first, last
