"""What chooses the controls, and what it says when it has chosen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from flywheel.records import Floats, Past, Trajectory
from flywheel.tasks.task import Task


@dataclass(frozen=True)
class Command:
    """What a controller wants done next.

    Attributes:
      controls: (S, W) commands for the next S >= 1 control steps; the controller is asked again after.
      plan_seconds: computing time the choice took [s]; 0 where nothing was planned.
      diagnostics: named arrays for figures and videos; nothing reads them to decide. "paths" (K, M, 2)
        are ways that the robot's centre of mass would take, the best one first [m].
      tail: (R, W) commands to go on with for as long as nothing newer was chosen; None to hold still.
    """

    controls: Floats
    plan_seconds: float = 0.0
    diagnostics: dict[str, Floats] = field(default_factory=dict)
    tail: Floats | None = None


@dataclass(frozen=True)
class Piece:
    """What just happened in an episode, from one choice of commands to the next.

    Attributes:
      done: control steps since the beginning.
      simulated: (1,) what the plant did, from the state before on.
      command: that it followed.
    """

    done: int
    simulated: Trajectory
    command: Command


# May raise to end a recording.
OnPiece = Callable[[Piece], None]


@runtime_checkable
class Controller(Protocol):
    """Anything that chooses controls for one robot.

    Attributes:
      name: for provenance: "random", "gait:roll", "mppi", ...
      model: digest of the weights it plans with, or "".
      history: past control steps it looks at; it is given at least that many where there are.
    """

    @property
    def name(self) -> str: ...

    @property
    def model(self) -> str: ...

    @property
    def history(self) -> int: ...

    def reset(self, task: Task | None, seed: int) -> None:
        """Begin an episode: forget the last one. All of its chance comes from `seed`.

        Raises:
          ConfigError: the controller needs a task and got none.
        """
        ...

    def act(self, past: Past) -> Command:
        """Choose the next commands.

        Args:
          past: of batch size 1; as long as the episode so far, at least `history` steps if it is
            that long.

        Raises:
          ModelError: nothing finite could be predicted from here.
        """
        ...
