"""Whatever goes wrong in a user's own link is said with its place, and the log is whole until then."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.data.recordings import read_recording
from flywheel.errors import ConfigError, LinkError
from flywheel.records import Floats
from flywheel.robot_link import RobotInfo, RobotLink, Sample
from flywheel.robot_link.opening import open_link
from flywheel.robots import Robot

PERIOD = 0.01
LATE = 5  # observations before it breaks


class Lab:
    """A robot that stands still, and breaks somewhere."""

    def __init__(self, robot: Robot, breaks: str = "") -> None:
        self.breaks, self.count = breaks, 0
        if breaks == "init":
            raise FileNotFoundError(2, "No such file or directory", "/dev/ttyUSB0")
        self.info = RobotInfo.of(robot, PERIOD)
        if breaks == "no info":
            self.info = None  # type: ignore[assignment]
        self.points = robot.points_of(robot.keyframe)
        self.winch = np.full(len(robot.winches), np.nan)

    def reset(self, seed: int = 0) -> None:
        if self.breaks == "reset":
            raise RuntimeError("not homed")

    def observe(self) -> Sample:
        self.count += 1
        time, points = PERIOD * self.count, self.points + 1e-4 * np.sin(self.count)
        if self.count > LATE:
            if self.breaks == "observe":
                raise OSError(5, "Input/output error")
            if self.breaks == "none":
                return None  # type: ignore[return-value]
            time = {"since 1970": 1.76e9, "nan": np.nan, "leap": 100.0}.get(self.breaks, time)
            points = points.T if self.breaks == "shape" else points
        return Sample(time, time, points, self.winch)

    def send(self, controls: Floats, valid_until: float) -> None:
        if self.breaks == "send" and self.count > LATE:
            raise ConnectionResetError("cable out")
        controls[:] = 1e9  # its own copy

    def stop(self) -> None:
        if self.breaks == "stop":
            raise OSError("no answer")

    close = stop


class Lists(Lab):
    """A robot that describes itself, and measures, in lists."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        names = {"points": list(self.info.points), "winches": list(self.info.winches)}
        limits = {n: getattr(self.info, n).tolist() for n in ("control_low", "control_high")}
        self.info = dataclasses.replace(self.info, **names, **limits)

    def observe(self) -> Sample:
        found = super().observe()
        return Sample(found.time, found.stamp, found.points.tolist(), found.winch.tolist())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("breaks", "kind", "words"),
    [
        ("init", LinkError, r"cannot be made: FileNotFoundError: .*ttyUSB0.*test_own.py, line \d+"),
        ("no info", ConfigError, "is not a RobotLink: it needs info, a RobotInfo"),
    ],
)
def test_a_link_that_cannot_be_made_says_why(
    breaks: str, kind: type[Exception], words: str, prism3: Robot
) -> None:
    with pytest.raises(kind, match=words):
        open_link(f"{__name__}:Lab", prism3, PERIOD, arguments={"breaks": breaks})


@pytest.mark.parametrize("text", ["raise RuntimeError('boom')", "x = = 3"])
def test_a_module_that_cannot_be_imported_says_why(
    text: str, prism3: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"lab_{len(text)}"
    (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ConfigError, match=f"{name} cannot be imported: (Runtime|Syntax)Error"):
        open_link(f"{name}:Lab", prism3, PERIOD)


def test_lists_are_as_good_as_arrays(prism3: Robot) -> None:
    link = open_link(f"{__name__}:Lists", prism3, PERIOD)
    assert isinstance(link, RobotLink) and isinstance(link.observe().points, np.ndarray)
    controls = np.zeros(6)
    link.send(controls, 1.0)
    assert not controls.any()


def drive(folder: Path, breaks: str) -> tuple[int, str]:
    done = CliRunner().invoke(
        app,
        ["drive", "smoke", "--model", "plant", "--robot", f"{__name__}:Lab", "--logs", str(folder)]
        + ["--argument", f"breaks={breaks}", "task.seconds=0.2", "mppi.samples=2"],
    )
    assert done.exception is None or isinstance(done.exception, SystemExit)
    return done.exit_code, " ".join(done.output.split())


@pytest.mark.parametrize(
    ("breaks", "words"),
    [
        ("observe", "observe: OSError: [Errno 5] Input/output error"),
        ("none", "observe: AttributeError"),
        ("shape", "measured points of the shape (3, 6)"),
        ("send", "send: ConnectionResetError: cable out"),
        ("since 1970", "in seconds since its reset"),
        ("nan", "gave the time nan s"),
        ("leap", "clock went on by 99."),
    ],
)
def test_a_robot_that_breaks_is_lost_and_its_log_is_kept(
    breaks: str, words: str, prism3: Robot, tmp_path: Path
) -> None:
    code, output = drive(tmp_path / "logs", breaks)
    assert code == 1 and "the link was lost after" in output and words in output
    assert [path.name for path in (tmp_path / "logs").iterdir()] == ["plant-0.csv"]
    (episode,) = read_recording(tmp_path / "logs" / "plant-0.csv", prism3).episodes
    assert LATE - 2 <= episode.trajectory.steps <= LATE


def test_a_robot_that_is_never_ready_is_bad_input(tmp_path: Path) -> None:
    code, output = drive(tmp_path / "logs", "reset")
    assert code == 2 and "Lab, reset: RuntimeError: not homed" in output
