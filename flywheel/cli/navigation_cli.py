"""`flywheel navigate`: what can be asked of a robot that drives to goals."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flywheel.cli.options import Overrides, within
from flywheel.quantities import SAMPLES, SEED

app = typer.Typer()

HiddenOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="EFFECT[@PLACE][:SIZE]",
        help="What the plant has beyond its MJCF, in place of what everybody is told: "
        "torque_speed:2 is twice its typical size. Or the path of an adopted plant.",
        show_default=False,
    ),
]
VideoOption = Annotated[
    Path | None,
    typer.Option(help="Where the video goes; navigate-<model>-<seed>.mp4 by default."),
]
ResultsOption = Annotated[
    Path | None,
    typer.Option(
        metavar="JSONL",
        help="Gets a line per episode; what it holds already is not driven again.",
        show_default=False,
    ),
]
PictureOption = Annotated[
    Path | None,
    typer.Option(
        metavar="PNG", help="Of all paths in the results, from above.", show_default=False
    ),
]
LogsOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER", help="Gets each episode as CSV, as a robot's log.", show_default=False
    ),
]


@app.command()
def navigate(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="RUN|CONFIG", help="A run's folder, or a configuration (with --model oracle)."
        ),
    ],
    overrides: Overrides = None,
    model: Annotated[
        str, typer.Option(help="champion, oracle (the plant itself), or an iteration's number.")
    ] = "champion",
    seed: Annotated[
        int, typer.Option(help="Of the task, and of the planner.", callback=within(SEED))
    ] = 0,
    episodes: Annotated[
        int, typer.Option(help="As many, with seeds from --seed on.", callback=within(SAMPLES))
    ] = 1,
    hidden: HiddenOption = None,
    watch: Annotated[
        bool, typer.Option("--watch", help="Show it live, where there is a display.")
    ] = False,
    film: Annotated[bool, typer.Option(help="Make a video of the first episode.")] = True,
    video: VideoOption = None,
    results: ResultsOption = None,
    picture: PictureOption = None,
    logs: LogsOption = None,
) -> None:
    """Drive to goals with MPPI, and film it.

    [bold]Examples[/bold]

    flywheel navigate runs/prism3 --seed 7 --watch

    flywheel navigate configs/prism3.yaml --model oracle

    flywheel navigate runs/s_course task.course=maze --episodes 10 --results maze.jsonl --picture maze.png

    flywheel navigate runs/s_course --hidden torque_speed --episodes 10 --logs logs/
    """
    from flywheel.cli.navigate import Wish, navigate

    navigate(
        Wish(
            source,
            tuple(overrides or ()),
            model,
            range(seed, seed + episodes),
            tuple(hidden or ()),
            video,
            film,
            watch,
            results,
            picture,
            logs,
        )
    )
