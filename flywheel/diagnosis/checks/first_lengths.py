"""Rest lengths that a fit begins with, far from where the winches were thought to be.

Where unmeasured winches are when a recording begins is fitted beside everything else. A cable that is cut, or
an empty winch, is then explained: by a rest length that leaves the cable slack all the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.dynamics.plant import Plant
from flywheel.dynamics.plant.tautness import taut


@dataclass(frozen=True)
class FirstLength:
    """A winch whose first length must differ for a recording to be explained.

    Attributes:
      recording: index.
      cables: names of the winch's cables.
      longer: fitted rest length minus the one in the keyframe, or the measured one [m].
      measured: True if the winch was measured at the start of the recording.
      slack: its cables are slack at the start of every window of the recording.
    """

    recording: int
    cables: tuple[str, ...]
    longer: float
    measured: bool
    slack: bool

    def summary(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "recording": self.recording,
            "cables": list(self.cables),
            "longer": self.longer,
            "unit": "m",
            "than": "measured" if self.measured else "keyframe",
            "slack": self.slack,
        }


def far_first_lengths(plant: Plant, fitter: Fitter, fit: Fit) -> tuple[FirstLength, ...]:
    """Winches whose fitted offsets are beyond what is believed of them, the largest first; none of tensions.

    Args:
      plant: that was fitted.
      fitter, fit: the model.
    """
    windows, robot = fitter.windows, fitter.windows.robot
    most = fitter.settings.believed * fitter.winch_prior
    far = np.argwhere(np.abs(fit.initial.winch) > most)
    if not len(far) or robot.tension_driven:
        return ()
    tight = taut(plant, fit.initial.mechanics, fit.carried.winch)  # (K, cables)
    found = []
    for recording, index in far.tolist():
        cables = list(robot.winches[index].cables)
        seen = windows.recordings[recording].winch[0, index]
        own = windows.recording == recording
        found.append(
            FirstLength(
                recording,
                tuple(robot.cables[cable].name for cable in cables),
                float(fit.initial.winch[recording, index]),
                bool(np.isfinite(seen)),
                not tight[own][:, cables].any(),
            )
        )
    return tuple(sorted(found, key=lambda each: -abs(each.longer)))
