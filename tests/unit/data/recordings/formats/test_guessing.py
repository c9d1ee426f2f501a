"""A draft of a map has the names of the files, and what the cables tell of the winches."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.data.recordings import guess, read_recording
from flywheel.dynamics.plant import cables_by_winches
from flywheel.errors import ConfigError, DataError
from flywheel.records import Trajectory
from flywheel.robots import load_robot
from tests.unit.data.recordings.formats import writers
from tests.unit.data.recordings.formats.test_formats import TIME, check, truth
from tests.unit.data.recordings.formats.truth import Truth, made

__all__ = ["truth"]


def test_a_draft_of_two_files_is_a_map_after_the_units_of_its_commands(
    truth: Truth, tmp_path: Path
) -> None:
    writers.motive(truth, tmp_path / "take.csv", TIME)
    writers.motors(truth, tmp_path / "motors.txt", TIME)
    text = guess([tmp_path / "motors.txt", tmp_path / "take.csv"], truth.robot, tmp_path)
    draft = yaml.safe_load(text)
    assert draft["files"][0] == {"path": "take.csv"}
    assert draft["files"][1]["time"] == "c1"
    assert draft["markers"] == {n: f"Platform:{n}" for n in writers.names(truth)}
    assert draft["axes"] == {"x": "x", "y": "-z", "z": "y"}
    assert "units" not in draft  # Motive says millimetres
    draft["commands"] = {"winch_fl": "c2", "winch_fr": "c3", "rear": {"from": "c4", "unit": "m"}}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(draft))
    check(read_recording(tmp_path / "map.yaml", truth.robot).episodes[0].trajectory, truth)


def test_winches_without_a_name_are_told_by_the_cables(tmp_path: Path) -> None:
    truth = made(20.0)
    time = np.arange(0, 19, 0.01)
    writers.qualisys(truth, tmp_path / "take.tsv", time)
    writers.motors(truth, tmp_path / "motors.txt", time, clock=1000 * (time + 3.3))
    lines = [
        " ".join([each.split()[i] for i in (0, 3, 1, 2)])
        for each in (tmp_path / "motors.txt").read_text().splitlines()
    ]
    (tmp_path / "motors.txt").write_text("stamp gamma alpha beta\n" + "\n".join(lines) + "\n")
    draft = yaml.safe_load(
        text := guess([tmp_path / "take.tsv", tmp_path / "motors.txt"], truth.robot, tmp_path)
    )
    assert draft["commands"] == {
        "winch_fl": "alpha",
        "winch_fr": "beta",
        "rear": {"from": "gamma", "unit": "m"},
    }
    assert draft["files"][1] == {"path": "motors.txt", "time": "stamp", "unit": "ms"}
    assert "guessed by what the cables do" in text
    draft["files"][1]["align"] = "auto"
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(draft))
    read = read_recording(tmp_path / "map.yaml", truth.robot, follow=cables_by_winches)
    (words,) = [f.words for f in read.report.findings if f.kind == "clock"]
    assert "its time 0 is -3.30" in words


def rows(path: Path, header: str, cells: list[list[str]], between: str = ",") -> Path:
    """A table of text."""
    path.write_text("\n".join([header, *(between.join(row) for row in cells)]) + "\n")
    return path


def imported_draft(paths: list[Path], truth: Truth, **changes: object) -> tuple[Trajectory, dict]:
    """The recording by a draft with some changes, and the draft."""
    folder = paths[0].parent
    draft = yaml.safe_load(guess(paths, truth.robot, folder))
    (folder / "map.yaml").write_text(yaml.safe_dump(draft | changes))
    return read_recording(folder / "map.yaml", truth.robot).episodes[0].trajectory, draft


def test_a_spreadsheet_has_decimal_commas_units_in_its_header_and_times_of_day(
    truth: Truth, tmp_path: Path
) -> None:
    points, told = truth.points(TIME), truth.commands(TIME)
    winches = [winch.name for winch in truth.robot.winches]
    clock = [f"{23 + (t >= 1)}:{59 if t < 1 else 0}:{(59 + t) % 60:06.3f}" for t in TIME]
    cells = [
        [at.replace("24:0", "0:00"), *(f"{1000 * x:.6f}" for x in [*p.ravel(), *u])]
        for at, p, u in zip(clock, points, told, strict=True)
    ]
    for row in cells[20:30]:
        row[4:7] = ["-", "--", "#N/A"]
    kinds = {"rate": "mm/s", "position": "mm"}
    header = [f"{n} {axis} [mm]" for n in writers.names(truth) for axis in "XYZ"]
    header += [f"Soll {w.name} [{kinds[w.kind]}]" for w in truth.robot.winches]
    path = tmp_path / "log.csv"
    rows(path, ";".join(["Uhrzeit", *header]), cells, ";")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b".", b","))
    track, draft = imported_draft([path], truth)
    check(track, truth)
    assert draft["files"] == [{"path": "log.csv", "time": "Uhrzeit"}]
    assert draft["units"] == {"points": "mm"}
    assert draft["commands"][winches[0]]["unit"] == "mm/s"
    assert draft["commands"][winches[2]] == {"from": f"Soll {winches[2]} [mm]", "unit": "mm"}


def test_a_row_of_units_is_no_measurement_and_numbered_commands_are_in_order(
    truth: Truth, tmp_path: Path
) -> None:
    names = [f"m{i}_{a}" for i in (1, 2, 3) for a in "xyz"]
    header = ",".join(["t", *names, "set1", "set2", "set3"])
    units = ["s", *["cm"] * 9, *["m/s"] * 3]
    cells = [
        [f"{t:.4f}", *(f"{100 * x:.7f}" for x in p.ravel()), *(f"{x:.7f}" for x in u)]
        for t, p, u in zip(TIME, truth.points(TIME), truth.commands(TIME), strict=True)
    ]
    path = rows(tmp_path / "log.csv", header, [units, *cells])
    track, draft = imported_draft([path], truth)
    check(track, truth, hidden=False)
    assert draft["units"] == {"points": "cm"}


def test_a_name_with_another_number_is_another_name(tmp_path: Path) -> None:
    robot = load_robot("prism3")
    rng = np.random.default_rng(0)
    names = [f"s{i}.{a}" for i in range(6) for a in "xyz"]
    cells = [[f"{0.01 * k:.2f}", *(f"{x:.4f}" for x in rng.random(18))] for k in range(20)]
    for row in cells:
        row[10:13] = ["lost"] * 3
    path = rows(tmp_path / "log.csv", ",".join(["time", *names]), cells)
    draft = yaml.safe_load(guess([path], robot, tmp_path))
    assert draft["markers"] == {f"s{i}": f"s{i}" if i != 3 else None for i in range(6)}


def test_a_counter_is_no_time_and_times_that_repeat_are_told(truth: Truth, tmp_path: Path) -> None:
    cells = [[str(k), f"{k // 3 / 100}", "a", "1.5"] for k in range(60)]
    path = rows(tmp_path / "log.csv", "frame,stamp,marker,x", cells)
    text = guess([path], truth.robot, tmp_path)
    assert yaml.safe_load(text)["files"] == [{"path": "log.csv", "rate": None}]
    assert "'stamp' has times more than once" in text


def test_a_pose_has_the_names_of_ros_and_json_is_refused(truth: Truth, tmp_path: Path) -> None:
    place, turn = truth.pose(TIME)
    fields = [f"field.pose.position.{a}" for a in "xyz"]
    fields += [f"field.pose.orientation.{a}" for a in "xyzw"]
    stamps = [str(1_700_000_000_000_000_000 + round(1e9 * t)) for t in TIME]
    cells = [
        [at, *(f"{x:.9f}" for x in [*p, *q, *u])]
        for at, p, q, u in zip(stamps, place, turn, truth.commands(TIME), strict=True)
    ]
    header = ",".join(["%time", *fields, "field.data0", "field.data1", "field.data2"])
    track, draft = imported_draft([rows(tmp_path / "log.csv", header, cells)], truth)
    check(track, truth, hidden=False)
    assert draft["files"] == [{"path": "log.csv", "time": "time", "unit": "ns"}]
    rows(tmp_path / "lines.csv", '{"t": 0.0, "x": [1.5, 2.5]}', [['{"t": 0.1']])
    with pytest.raises(DataError, match="is JSON. Write its numbers as CSV"):
        guess([tmp_path / "lines.csv"], truth.robot, tmp_path)
    with pytest.raises(DataError, match="each file once"):
        guess([tmp_path / "lines.csv", tmp_path / "." / "lines.csv"], truth.robot, tmp_path)


@pytest.mark.parametrize("unit", ["mm", "cm"])
def test_the_unit_of_the_points_is_that_of_the_robot(
    unit: str, truth: Truth, tmp_path: Path
) -> None:
    size = {"mm": 1000, "cm": 100}[unit]
    np.savez(tmp_path / "log.npz", t=TIME, m=size * truth.points(TIME), u=truth.commands(TIME))
    draft = yaml.safe_load(text := guess([tmp_path / "log.npz"], truth.robot, tmp_path))
    assert draft["units"] == {"points": unit}
    assert "axes" not in draft
    assert draft["markers"] == {"front": "m[0]", "left": "m[1]", "right": "m[2]"}
    assert "in the order of the file" in text


def test_the_command_writes_a_draft_once(truth: Truth, tmp_path: Path) -> None:
    writers.motive(truth, tmp_path / "take.csv", TIME)
    (tmp_path / "robot.xml").write_text(truth.robot.xml)
    command = [
        "recordings",
        "guess",
        str(tmp_path / "take.csv"),
        "--robot",
        str(tmp_path / "robot.xml"),
    ]
    printed = CliRunner().invoke(app, command)
    assert printed.exit_code == 0, printed.output
    assert "Platform:front" in printed.output
    for code in (0, 2):
        done = CliRunner().invoke(app, [*command, "-o", str(tmp_path / "map.yaml")])
        assert done.exit_code == code, done.output
    assert yaml.safe_load((tmp_path / "map.yaml").read_text())["files"] == [{"path": "take.csv"}]


def test_a_file_that_cannot_be_read_gives_no_draft(truth: Truth, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"\x80\x04\x95")
    with pytest.raises(DataError, match="pickle"):
        guess([tmp_path / "a.csv"], truth.robot, tmp_path)


def test_a_file_of_poses_in_an_array_is_told_with_its_columns(truth: Truth, tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", t=TIME, p=np.zeros((len(TIME), 6)))
    text = guess([tmp_path / "log.npz"], truth.robot, tmp_path)
    assert "or poses of bodies; there are: t, p[0], p[1], p[2], p[3], p[4], p[5]\n" in text


def log(truth: Truth, path: Path, points: list[str], told: list[str], scale: float = 1.0) -> Path:
    """A table of the times, points and commands in columns of these names, with a row twice."""
    cells = [
        [f"{t:.4f}", *(f"{scale * x:.7f}" for x in p.ravel()), *(f"{x:.7f}" for x in u)]
        for t, p, u in zip(TIME, truth.points(TIME), truth.commands(TIME), strict=True)
    ]
    return rows(path, ",".join(["t [s]", *points, *told]), [*cells[:90], *cells[89:]])


@pytest.mark.parametrize(
    ("spelled", "told", "scale"),
    [
        ("{n}_Pos_{a}_mm", ["FL_mm", "FR_mm", "Rear_mm"], 1000.0),
        ("{n}{a}", ["fl", "fr", "rear"], 1 / 0.0254),
        ("{i}{a}", ["u_fl", "u_fr", "u_rear"], 100.0),
        ("{n}_{a}", ["cmd_fl", "cmd_fr", "cmd_rear"], 1.0),
        ("Rig {n} {a}", ["w1", "w2", "w3"], 1000.0),
    ],
)
def test_columns_of_a_marker_end_in_x_y_and_z_however_they_are_spelled(
    spelled: str, told: list[str], scale: float, truth: Truth, tmp_path: Path
) -> None:
    names = [
        spelled.format(n=name.title(), i=f"P{i}", a=axis.upper() if "_" in spelled else axis)
        for i, name in enumerate(writers.names(truth))
        for axis in "xyz"
    ]
    others = [f"enc_{name}" for name in ("fl", "fr", "rear")]  # measured, and no commands
    path = log(truth, tmp_path / "log.csv", names, told, scale)
    table = [line.split(",") for line in path.read_text().splitlines()]
    more = [others, *([str(i)] * 3 for i in range(len(table) - 1))]
    rows(
        path, ",".join(table[0] + others), [a + b for a, b in zip(table[1:], more[1:], strict=True)]
    )
    units = {"commands": {w.name: {"from": n, "unit": "m"} if w.kind == "position" else n
                          for w, n in zip(truth.robot.winches, told, strict=True)}}  # fmt: skip
    track, draft = imported_draft([path], truth, **units)
    check(track, truth, hidden=False)
    found = [each if isinstance(each, str) else each["from"] for each in draft["commands"].values()]
    assert found == told


def test_a_pose_is_a_position_and_a_quaternion_by_any_name(truth: Truth, tmp_path: Path) -> None:
    place, turn = truth.pose(TIME)
    velocity = np.gradient(place, axis=0)
    cells = [
        [str(round(1e6 * t) + 123456789), *(f"{x:.9f}" for x in [*v, *p, *q[[3, 0, 1, 2]], *u])]
        for t, v, p, q, u in zip(TIME, velocity, place, turn, truth.commands(TIME), strict=True)
    ]
    header = "us,vx,vy,vz,px,py,pz,qw,qx,qy,qz,fl_cmd,fr_cmd,rear_cmd"
    track, draft = imported_draft([rows(tmp_path / "log.csv", header, cells)], truth)
    check(track, truth, hidden=False)
    assert draft["poses"]["platform"]["rotation"] == ["qx", "qy", "qz", "qw"]


def test_commands_in_degrees_of_a_drum_ask_for_its_radius(truth: Truth, tmp_path: Path) -> None:
    names = [f"{n}{a}" for n in writers.names(truth) for a in "xyz"]
    path = log(truth, tmp_path / "log.csv", names, ["FL_vel_deg_s", "FR_vel_deg_s", "Rear_rad"])
    text = guess([path], truth.robot, tmp_path)
    assert "commands that are angles of a drum need its radius" in text
    assert yaml.safe_load(text)["commands"] == {
        "winch_fl": {"from": "FL_vel_deg_s", "unit": "deg/s"},
        "winch_fr": {"from": "FR_vel_deg_s", "unit": "deg/s"},
        "rear": {"from": "Rear_rad", "unit": "rad"},
    }


def test_commands_that_are_not_found_are_to_fill_in(truth: Truth, tmp_path: Path) -> None:
    points = truth.points(TIME)
    np.savez(tmp_path / "log.npz", time=TIME, markers=points.reshape(len(TIME), -1))
    text = guess([tmp_path / "log.npz"], truth.robot, tmp_path)
    draft = yaml.safe_load(text)
    assert "markers are in the order of the file, three numbers for each" in text
    assert draft["commands"] == dict.fromkeys((w.name for w in truth.robot.winches), None)
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(ConfigError, match="commands.rear: to fill in: a column, or hold"):
        read_recording(tmp_path / "map.yaml", truth.robot)


def test_three_numbers_for_each_marker_are_found_beside_three_commands(
    truth: Truth, tmp_path: Path
) -> None:
    points, told = truth.points(TIME), truth.commands(TIME)
    np.savez(tmp_path / "log.npz", time=TIME, p=points.reshape(len(TIME), -1), cmd=told)
    track, _ = imported_draft([tmp_path / "log.npz"], truth)
    check(track, truth, hidden=False)


@pytest.mark.parametrize("unseen", ["xyz", "z"])
def test_a_draft_of_a_log_in_which_no_marker_was_seen(
    unseen: str, truth: Truth, tmp_path: Path
) -> None:
    names = [f"{n}.{a}" for n in writers.names(truth) for a in "xyz"]
    points = [["" if n[-1] in unseen else "1.5" for n in names] for _ in range(20)]
    cells = [[f"{k / 100}", *row, "0"] for k, row in enumerate(points)]
    path = rows(tmp_path / "log.csv", ",".join(["t", *names, "u"]), cells)
    draft = yaml.safe_load(guess([path], truth.robot, tmp_path))
    assert set(draft["markers"].values()) == set(writers.names(truth)) and "axes" not in draft
