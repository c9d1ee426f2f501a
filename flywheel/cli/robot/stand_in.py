"""Options that describe a stand-in for a robot, beyond its MJCF."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.options import within
from flywheel.quantities import CONTROL_STEP, Bounds

if TYPE_CHECKING:
    from flywheel.robot_link import StandInConfig

PeriodOption = Annotated[
    float, typer.Option(help="Control period, in seconds.", callback=within(CONTROL_STEP))
]


@dataclass(frozen=True)
class StandInOptions:
    """Options that describe a stand-in, as in `StandInConfig`."""

    hidden: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT[@PLACE][:SIZE]",
            help="Effect beyond its MJCF, unknown to the driver: torque_speed:2 is twice its typical "
            "size. Repeatable.",
        ),
    ] = None
    noise: Annotated[
        float,
        typer.Option(
            help="Noise of each coordinate, as a fraction of the robot's length.",
            callback=within(Bounds(0, 1)),
        ),
    ] = 0.003
    rate: Annotated[
        float | None,
        typer.Option(
            help="Measurements per second; one in every control period by default.",
            callback=within(Bounds(0.1, 10_000, "Hz")),
        ),
    ] = None
    latency: Annotated[
        float,
        typer.Option(
            help="Age of measurements on arrival, in seconds.", callback=within(Bounds(0, 1, "s"))
        ),
    ] = 0.0
    latency_told: Annotated[
        bool,
        typer.Option(
            "--latency-told/--latency-hidden", help="Include the latency in their stamps."
        ),
    ] = True
    dropout: Annotated[
        float,
        typer.Option(help="Fraction of missing points.", callback=within(Bounds(0, 1, below=True))),
    ] = 0.0
    winch_measured: Annotated[
        bool,
        typer.Option(
            "--encoders", help="Measure all winches, also those without a sensor in the MJCF."
        ),
    ] = False

    def config(self) -> StandInConfig:
        """The stand-in of the options."""
        from flywheel.robot_link import StandInConfig

        return StandInConfig(**{**vars(self), "hidden": tuple(self.hidden or ())})
