"""`flywheel robot log`: a log from a transcript."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from flywheel.cli.console import console


def log(
    transcript: Annotated[Path, "TRANSCRIPT"],
    out: Annotated[Path, "OUT.csv"],
    robot: Annotated[str, "ROBOT"] = "prism3",
) -> None:
    """Make a log from a transcript, up to its end, e.g. if the driver was killed.

    [bold]Example[/bold]

    flywheel robot log drives/plant-0.jsonl monday.csv my_robot.xml

    Args:
      transcript: A .jsonl file of a drive.
      out: Output file of the log.
      robot: Your .xml, or a shipped robot's name.
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
    found = replayed(link, owner, out.stem, about, reckoning)
    write_recording(found.episode, out, owner)
    seconds = found.episode.trajectory.steps * link.info.period
    console().print(f"{seconds:.2f} s are in {out}.")
