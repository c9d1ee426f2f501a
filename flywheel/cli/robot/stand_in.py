"""Options that describe a stand-in for a robot, beyond its MJCF."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from flywheel.quantities import Bounds, PartialShare, Share

if TYPE_CHECKING:
    from flywheel.robot_link import StandInConfig


@dataclass(frozen=True)
class StandInOptions:
    """Options that describe a stand-in, as in `StandInConfig`.

    Attributes:
      hidden: Effect beyond its MJCF, unknown to the driver: torque_speed:2 is twice its typical size.
        Repeatable.
      noise: Noise of each coordinate, as a fraction of the robot's length.
      rate: Measurements per second; one in every control period by default.
      latency: Age of measurements on arrival, in seconds.
      latency_told: Include the latency in their stamps.
      dropout: Fraction of missing points.
      winch_measured: Measure all winches, also those without a sensor in the MJCF.
    """

    hidden: Annotated[tuple[str, ...], "EFFECT[@PLACE][:SIZE]"] = ()
    noise: Share = 0.003
    rate: Annotated[float | None, Bounds(0.1, 10_000, "Hz")] = None
    latency: Annotated[float, Bounds(0, 1, "s")] = 0.0
    latency_told: Annotated[bool, "--latency-told/--latency-hidden"] = True
    dropout: PartialShare = 0.0
    winch_measured: Annotated[bool, "--encoders"] = False

    def config(self) -> StandInConfig:
        """The stand-in of the options."""
        from flywheel.robot_link import StandInConfig

        return StandInConfig(**vars(self))
