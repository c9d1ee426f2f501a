"""`flywheel robot log`: a log from a transcript."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flywheel.cli.console import console
from flywheel.cli.robot.serve import RobotArgument

TranscriptArgument = Annotated[
    Path, typer.Argument(metavar="TRANSCRIPT", help="A .jsonl file of a drive.")
]
LogArgument = Annotated[Path, typer.Argument(metavar="OUT.csv", help="Output file of the log.")]


def log(transcript: TranscriptArgument, out: LogArgument, robot: RobotArgument = "prism3") -> None:
    """Make a log from a transcript, up to its end, e.g. if the driver was killed.

    [bold]Example[/bold]

    flywheel robot log drives/plant-0.jsonl monday.csv my_robot.xml
    """
    from flywheel.control.drive import replayed
    from flywheel.data.recordings import write_recording
    from flywheel.dynamics.plant import Reckoning
    from flywheel.outputs import check_outputs
    from flywheel.records import RECORDING, Provenance
    from flywheel.robot_link import ReplayedLink
    from flywheel.robots import load_robot

    check_outputs({"log": out}, inputs=[transcript])
    owner, link = load_robot(robot), ReplayedLink(transcript)
    about = Provenance(owner.digest, source=RECORDING, dataset=RECORDING)
    reckoning = Reckoning(owner, link.info.period)
    found = replayed(link, owner, episode_id=out.stem, provenance=about, reckoning=reckoning)
    write_recording(found.episode, out, owner)
    seconds = found.episode.trajectory.steps * link.info.period
    console().print(f"{seconds:.2f} s are in {out}.")
