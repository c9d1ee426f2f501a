"""Where and when something acts that no effect explains.

When, and at which tracked point: where most is left of the residual, in pieces of a tenth of a window. At
which cable: whose change alone would explain most of what is left in that window, by any effect of the
library that acts on single cables.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fitter
from flywheel.diagnosis.selection.score_test import ScoreTest
from flywheel.diagnosis.settings import CheckSettings
from flywheel.records import Floats


@dataclass(frozen=True)
class Location:
    """Where and when most of what is left acts.

    Attributes:
      cables: (K, C) squares that a change of each cable explains in each window alone [sigma^2].
      recording: index of the one in which most is left.
      begin, end: of the time there in which it is [s].
      point: at which it is.
      cable: that explains most in the window where it is; "" where the library has no effect on cables.
    """

    cables: Floats
    recording: int
    begin: float
    end: float
    point: str
    cable: str

    def summary(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "recording": self.recording,
            "from": self.begin,
            "to": self.end,
            "unit": "s",
            "point": self.point,
            "cable": self.cable,
        }


def localise(
    fitter: Fitter, test: ScoreTest, settings: CheckSettings = CheckSettings()
) -> Location:
    """Find where and when what a test's model leaves acts."""
    windows, robot = fitter.windows, fitter.windows.robot
    cables = _explained(fitter, test)
    in_noise = (windows.sigma / windows.noise) ** 2
    pieces = in_noise * _pieces(fitter, test, settings.pieces)  # (K, pieces, P)
    over_points = pieces.mean(axis=2)
    window, piece = (int(i) for i in np.unravel_index(over_points.argmax(), over_points.shape))
    first, last = _run(over_points[window], piece, settings.half)
    length = windows.steps * windows.dt / pieces.shape[1]
    start = windows.first[window] * windows.dt
    point = int(pieces[window, first : last + 1].mean(axis=0).argmax())
    cable = robot.cables[int(cables[window].argmax())].name if cables.any() else ""
    return Location(
        cables,
        int(windows.recording[window]),
        float(start + first * length),
        float(start + (last + 1) * length),
        robot.points[point].name,
        cable,
    )


def _explained(fitter: Fitter, test: ScoreTest) -> Floats:
    """(K, C) most that any effect at each cable explains in each window."""
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


def _pieces(fitter: Fitter, test: ScoreTest, count: int) -> Floats:
    """(K, pieces, P) mean square of what is left, over time, of each tracked point."""
    windows, shape = fitter.windows, fitter.windows.measured.shape
    left = test.left.reshape(shape[0], -1)[:, : int(np.prod(shape[1:]))]
    squares, noisy = windows.squares(left).reshape(shape), windows.noisy
    parts = np.array_split(np.arange(shape[1]), min(count, shape[1]))
    means = [
        squares[:, part].sum(axis=(1, 3)) / np.maximum(noisy[:, part].sum(axis=(1, 3)), 1)
        for part in parts
    ]
    return np.stack(means, axis=1)


def _run(pieces: Floats, highest: int, half: float) -> tuple[int, int]:
    """First and last of the pieces around the highest that stand out as it does."""
    above = pieces > 1.0 + half * max(pieces[highest] - 1.0, 0.0)
    first = last = highest
    while first > 0 and above[first - 1]:
        first -= 1
    while last + 1 < len(pieces) and above[last + 1]:
        last += 1
    return first, last
