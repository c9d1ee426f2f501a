"""Interface of controllers, and the record of their choice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from flywheel.records import Floats, Past, Provenance, Split, Trajectory
from flywheel.tasks.task import Task


@dataclass(frozen=True)
class Command:
    """A controller's choice for the next control steps.

    Attributes:
      controls: (S, W) commands for the next S >= 1 control steps; the controller is asked again
        after them.
      plan_seconds: computing time of the choice [s]; 0 without planning.
      diagnostics: named arrays for figures and videos only. "paths" (K, M, 2) are predicted paths
        of the robot's centre of mass, best first [m].
      tail: (R, W) commands to continue with until a newer choice; None to hold.
    """

    controls: Floats
    plan_seconds: float = 0.0
    diagnostics: dict[str, Floats] = field(default_factory=dict)
    tail: Floats | None = None


@dataclass(frozen=True)
class EpisodeOrder:
    """An episode to be recorded.

    Attributes:
      id, provenance, split: of the episode.
      seconds: its longest duration [s].
      seed: of the controller and of the measurement.
    """

    id: str
    provenance: Provenance
    seconds: float
    seed: int
    split: Split = "train"


@dataclass(frozen=True)
class Piece:
    """Part of an episode, from one choice of commands to the next.

    Attributes:
      done: control steps since the beginning.
      simulated: (1,) motion of the plant, starting with the previous state.
      command: the choice that it followed.
    """

    done: int
    simulated: Trajectory
    command: Command


# May raise to end a recording.
OnPiece = Callable[[Piece], None]


@runtime_checkable
class Controller(Protocol):
    """Any source of controls for one robot.

    Attributes:
      name: for provenance: "random", "gait:roll", "mppi", ...
      model: digest of the weights used for planning, or "".
      history: number of past control steps used. It is given at least that many once they exist.
    """

    @property
    def name(self) -> str: ...

    @property
    def model(self) -> str: ...

    @property
    def history(self) -> int: ...

    def reset(self, task: Task | None, seed: int) -> None:
        """Start an episode without memory of the last one. All randomness comes from `seed`.

        Raises:
          ConfigError: the controller needs a task and got none.
        """
        ...

    def act(self, past: Past) -> Command:
        """Choose the next commands.

        Args:
          past: of batch size 1; as long as the episode so far, at least `history` steps once they
            exist.

        Raises:
          ModelError: no finite prediction from here.
        """
        ...
