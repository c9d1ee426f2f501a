"""Effects that no experiment of a list tells apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from flywheel.diagnosis.experiments.information import foresee, played
from flywheel.diagnosis.selection.candidates import Candidate
from flywheel.dynamics.plant import Plant
from flywheel.records import Floats

SAME = 0.999  # |cosine| from which two candidates are one


@dataclass(frozen=True)
class Equivalence:
    """Two candidates that change the same.

    Attributes:
      first, second: the candidates.
      least: their least |cosine| over the scripts that show either.
    """

    first: Candidate
    second: Candidate
    least: float


def equivalences(
    plant: Plant,
    scripts: Floats,
    library: Sequence[Candidate],
    sigma: float,
    same: float = SAME,
) -> tuple[Equivalence, ...]:
    """Pairs of candidates that are alike under every script, the most alike first.

    What starts, winches' offsets and smaller time steps explain is taken out of both before. A
    script that shows neither of two (no delay shows while the winches rest) says nothing of them.

    Args:
      plant: as it is known.
      scripts: (S, T, W) commands.
      library: candidates.
      sigma: noise of each coordinate [m].
      same: |cosine| above which two are alike.

    Raises:
      DataError, ModelError: see `foresee`.
    """
    foresight = foresee(plant, scripts, played(plant, scripts), library, sigma)
    found = []
    for i, j in combinations(range(len(library)), 2):
        if len(library[i].typical) != len(library[j].typical):
            continue
        telling = foresight.shown(i) | foresight.shown(j)
        least = float(foresight.cosines(i, j)[telling].min(initial=1.0))
        if telling.any() and least > same:
            found.append(Equivalence(library[i], library[j], least))
    return tuple(sorted(found, key=lambda pair: -pair.least))
