"""The common interface of all dynamics models."""

from typing import Protocol, runtime_checkable

from flywheel.records import Floats, Past, Rollout
from flywheel.robots import Robot


@runtime_checkable
class Dynamics(Protocol):
    """Any predictor of the tracked points.

    MuJoCo, the graph network, the analytic baselines and a model with added physics all implement
    `rollout`; planners, evaluation and diagnosis do not depend on the kind of model.

    Attributes:
      robot: the robot it predicts.
      dt: control step it predicts at [s].
      history: past steps it can use; a `Past` may be longer or shorter (see `Past.latest`).
    """

    @property
    def robot(self) -> Robot: ...

    @property
    def dt(self) -> float: ...

    @property
    def history(self) -> int: ...

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        """Predict the points under `controls`.

        Args:
          past: of batch size B, or 1 to start all B candidates from the same present.
          controls: (B, H, W) commands; clipped to the actuators' range.

        Raises:
          ModelError: shapes do not fit the robot, or the prediction is not finite.
        """
        ...
