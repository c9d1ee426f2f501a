"""Options that describe a stand-in for a robot, beyond its MJCF."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.options import within
from flywheel.quantities import CONTROL_STEP, Bounds

if TYPE_CHECKING:
    from flywheel.robot_link import StandInConfig

HiddenOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="EFFECT[@PLACE][:SIZE]",
        help="Effect beyond its MJCF, unknown to the driver: torque_speed:2 is twice its typical "
        "size. Repeatable.",
    ),
]
NoiseOption = Annotated[
    float,
    typer.Option(
        help="Noise of each coordinate, as a fraction of the robot's length.",
        callback=within(Bounds(0, 1)),
    ),
]
RateOption = Annotated[
    float | None,
    typer.Option(
        help="Measurements per second; one in every control period by default.",
        callback=within(Bounds(0.1, 10_000, "Hz")),
    ),
]
LatencyOption = Annotated[
    float,
    typer.Option(
        help="Age of measurements on arrival, in seconds.", callback=within(Bounds(0, 1, "s"))
    ),
]
ToldOption = Annotated[
    bool,
    typer.Option("--latency-told/--latency-hidden", help="Include the latency in their stamps."),
]
DropoutOption = Annotated[
    float,
    typer.Option(help="Fraction of missing points.", callback=within(Bounds(0, 1, below=True))),
]
EncodersOption = Annotated[
    bool,
    typer.Option(
        "--encoders", help="Measure all winches, also those without a sensor in the MJCF."
    ),
]
PeriodOption = Annotated[
    float, typer.Option(help="Control period, in seconds.", callback=within(CONTROL_STEP))
]


def stand_in_config(
    hidden: list[str] | None,
    noise: float,
    rate: float | None,
    latency: float,
    latency_told: bool,
    dropout: float,
    encoders: bool,
) -> StandInConfig:
    """The stand-in of the options."""
    from flywheel.robot_link import StandInConfig

    return StandInConfig(
        hidden=tuple(hidden or ()),
        noise=noise,
        rate=rate,
        latency=latency,
        latency_told=latency_told,
        dropout=dropout,
        winch_measured=encoders,
    )
