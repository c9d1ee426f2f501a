"""Files of each format about a known motion, as the programs write them that people use."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.records import Floats
from tests.unit.data.recordings.formats.truth import Y_UP, Truth

MM = 1000.0
RATE = 100.0
EPOCH = 1.7e9  # time 0 of messages, since 1970 [s]
MARKERS, COMMANDED = "markers", "u"  # parts of a log, which may be in files of their own
WHOLE = (MARKERS, COMMANDED)
NEEDS = {"hdf5": "h5py", "mat73": "h5py", "c3d": "ezc3d", "mcap": "mcap"} | dict.fromkeys(
    ("bag1", "bag2"), "rosbags"
)  # packages that are extras


def _map(markers: str, commands: str, *names: tuple[str, str, str]) -> str:
    """A map whose markers and commands are `markers[NAME]` and `commands[NAME]`."""
    points, told = names[0], names[-1]
    return (
        f"markers: {{front: '{markers % points[0]}', left: '{markers % points[1]}', "
        f"right: '{markers % points[2]}'}}\n"
        f"commands: {{winch_fl: '{commands % told[0]}', winch_fr: '{commands % told[1]}', "
        f"rear: {{from: '{commands % told[2]}', unit: m}}}}\n"
    )


_FIRST, _NINE = ("0", "1", "2"), ("0:3", "3:6", "6:9")
_MESSAGES = _map("/markers.data[%s]", "/motors.data[%s]", _NINE, _FIRST)
MOTORS = "{path: motors.txt, columns: [t, a, b, c, ticks, rear]}"
COMMANDS = "commands: {winch_fl: a, winch_fr: b, rear: {from: c, unit: m}}\n"
MAPS = {
    "npz": _map("markers[%s]", "u[%s]", _FIRST),
    "mat": _map("log.markers[%s]", "log.u[%s]", _FIRST) + "files: [{path: log.bin, time: log.t}]\n",
    "hdf5": _map("one/markers[%s]", "one/u[%s]", _FIRST)
    + "files: [{path: log.bin, time: one/t}]\n",
    "mat73": _map("log.markers[%s]", "log.u[%s]", _FIRST)
    + "files: [{path: log.bin, time: log.t}]\n",
    "parquet": "columns: {time: t}\ncommands: {rear: {from: ctrl.rear, unit: m}}\n",
    "lerobot": "files: [{path: log.bin, where: {episode_index: 1}}]\n"
    + _map(
        "observation.state.%s",
        "action.%s",
        ("front", "left", "right"),
        ("winch_fl", "winch_fr", "rear"),
    ),
    "c3d": f"files: [{{path: log.bin}}, {MOTORS}]\n{COMMANDS}",
    "mcap": _MESSAGES,
    "bag1": _MESSAGES,
    "bag2": _MESSAGES,
}


def log_name(kind: str) -> str:
    """Name of a file of a format, where its writer wants one."""
    return {"npz": "log.npz", "bag1": "log.bag"}.get(kind, "log.bin")


def cell(value: float, digits: int = 6) -> str:
    return "" if np.isnan(value) else f"{value:.{digits}f}"


def seen(truth: Truth, time: Floats) -> Floats:
    """Positions (N, P, 3), with a marker that is not seen for a while."""
    points = truth.points(time)
    points[20:30, 1] = np.nan
    return points


def names(truth: Truth) -> list[str]:
    return [point.name for point in truth.robot.points]


def motive(truth: Truth, path: Path, time: Floats, version: str = "1.23") -> Path:
    """Motive's, with y up: a body, its markers as computed and as measured, one that is lost and found."""
    place, turn = truth.pose(time)
    turn = np.concatenate([turn[:, :3] @ Y_UP.T, turn[:, 3:]], axis=1)
    points = seen(truth, time) @ Y_UP.T * MM
    place = place @ Y_UP.T * MM
    heads: list[tuple[str, str, str, str, str]] = [
        ("Rigid Body", "Platform", "1", "Rotation", a) for a in "XYZW"
    ]
    heads += [("Rigid Body", "Platform", "1", "Position", a) for a in "XYZ"]
    heads += [("Rigid Body", "Platform", "1", "Mean Marker Error", "")]
    columns = [*turn.T, *place.T, np.full(len(time), 0.1)]
    for kind, values in (
        ("Rigid Body Marker", truth.points(time) @ Y_UP.T * MM + 5.0),
        ("Marker", points),
    ):
        for i, name in enumerate(names(truth)):
            heads += [(kind, f"Platform:{name}", f"A{i}", "Position", a) for a in "XYZ"]
            columns += list(values[:, i].T)
    half = len(time) // 2
    for part in (
        slice(None, half),
        slice(half, None),
    ):  # a marker that comes back under the same name
        heads += [("Marker", "Unlabeled 1189", "", "Position", a) for a in "XYZ"]
        other = np.full((len(time), 3), np.nan)
        other[part] = points[part, 0] + 100.0
        columns += list(other.T)
    about = (
        f"Format Version,{version},Take Name,one,Capture Frame Rate,{RATE:f},Export Frame Rate,{RATE:f},"
        "Rotation Type,Quaternion,Length Units,Millimeters,Coordinate Space,Global"
    )
    new = version >= "1.24"
    rows = list(zip(*heads, strict=True))
    label = (
        (["Type", "Name", "ID"] + (["Parent"] if new else []) + [""]) if new else ["", "", "", ""]
    )
    if new:
        rows = [rows[0], rows[1], rows[2], tuple("" for _ in heads), rows[3], rows[4]]
    lines = [about, ""]
    lines += [
        ",".join(["", f'"{label[i]}"' if label[i] else "", *row]) for i, row in enumerate(rows[:-1])
    ]
    lines += [",".join(["Frame", "Time (Seconds)", *rows[-1]])]
    for i, row in enumerate(np.stack(columns, axis=1)):
        lines.append(",".join([str(i), f"{time[i]:.6f}", *map(cell, row)]))
    if version == "1.1":
        lines = _older(lines)
    path.write_text("\ufeff" + "\r\n".join(lines) + "\r\n", encoding="utf-8")
    return path


def _older(lines: list[str]) -> list[str]:
    """As Motive 1.x writes it: no unit, another name of the time, markers without their body's name."""
    lines[0] = lines[0].replace("Length Units,Millimeters,", "")
    lines[3] = ",".join(
        name.replace("Platform:", "") if kind == "Rigid Body Marker" else name
        for kind, name in zip(lines[2].split(","), lines[3].split(","), strict=True)
    )
    lines[6] = lines[6].replace("Time (Seconds)", "Time")
    return lines


def vicon(truth: Truth, path: Path, time: Floats, parts: Sequence[str] = WHOLE) -> Path:
    """Nexus', with a block of devices before that of the trajectories, and a row of units."""
    points = seen(truth, time) * MM
    told = truth.commands(time)
    lines = ["Devices", f"{RATE:g}", ",,Motor - Rate," + "," * (told.shape[1] - 2)]
    lines += [
        "Frame,Sub Frame," + ",".join(w.name for w in truth.robot.winches),
        ",," + ",".join(["m/s"] * told.shape[1]),
    ]
    lines += [f"{i + 1},0," + ",".join(map(cell, row)) for i, row in enumerate(told)]
    lines = [*lines, ""] if COMMANDED in parts else []
    lines += [
        "Trajectories",
        f"{RATE:g}",
        ",," + ",,,".join(f"robot:{n}" for n in names(truth)) + ",,",
    ]
    lines += [
        "Frame,Sub Frame" + ",X,Y,Z" * points.shape[1],
        ",," + ",".join(["mm"] * 3 * points.shape[1]),
    ]
    for i, row in enumerate(points.reshape(len(time), -1)):
        lines.append(f"{i + 1},0," + ",".join(map(cell, row)))
    path.write_text("\n".join(lines) + "\n")
    return path


def qualisys(truth: Truth, path: Path, time: Floats, frames: bool = True) -> Path:
    """QTM's, with or without the columns of frames and times; an unseen marker is at the origin."""
    points = np.nan_to_num(seen(truth, time) * MM)
    lines = [
        f"NO_OF_FRAMES\t{len(time)}", "NO_OF_CAMERAS\t8", f"NO_OF_MARKERS\t{points.shape[1]}",
        f"FREQUENCY\t{RATE:g}", "NO_OF_ANALOG\t0", "ANALOG_FREQUENCY\t0", "DESCRIPTION\t--",
        "TIME_STAMP\t2026-11-29, 10:00:00\t12345.6", "DATA_INCLUDED\t3D",
        "MARKER_NAMES\t" + "\t".join(names(truth)),
    ]  # fmt: skip
    if frames:
        lines.append("Frame\tTime\t" + "\t".join(f"{n} {a}" for n in names(truth) for a in "XYZ"))
    for i, row in enumerate(points.reshape(len(time), -1)):
        begin = f"{i + 1}\t{time[i]:.5f}\t" if frames else ""
        lines.append(begin + "\t".join(f"{v:.3f}" for v in row) + "\t")
    path.write_text("\n".join(lines) + "\n")
    return path


def trc(truth: Truth, path: Path, time: Floats) -> Path:
    """OpenSim's; times are rounded to 1 ms, an unseen marker has empty cells."""
    points = seen(truth, time) * MM
    count = points.shape[1]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{RATE:g}\t{RATE:g}\t{len(time)}\t{count}\tmm\t{RATE:g}\t1\t{len(time)}",
        "Frame#\tTime\t" + "\t\t\t".join(names(truth)) + "\t\t",
        "\t\t" + "\t".join(f"{a}{i + 1}" for i in range(count) for a in "XYZ"),
        "",
    ]
    for i, row in enumerate(points.reshape(len(time), -1)):
        lines.append(f"{i + 1}\t{time[i]:.3f}\t" + "\t".join(cell(v, 4) for v in row))
    path.write_text("\n".join(lines) + "\n")
    return path


def motors(truth: Truth, path: Path, time: Floats, clock: Floats | None = None) -> Path:
    """A controller's: blanks, no header; its own clock, a drum's angle in ticks for the first winch."""
    told, winch = truth.commands(time), truth.winch(time)
    ticks = winch[:, :1] / (2 * np.pi * 0.02) * 4096
    table = np.concatenate(
        [(time if clock is None else clock)[:, None], told, ticks, winch[:, 2:] * MM], axis=1
    )
    path.write_text("".join("  ".join(f"{v:.6f}" for v in row) + "\n" for row in table))
    return path


def arrays(truth: Truth, time: Floats, parts: Sequence[str] = WHOLE) -> dict[str, Floats]:
    """Times, and markers (N, P, 3), commands (N, W), or both."""
    made = {MARKERS: seen(truth, time), COMMANDED: truth.commands(time)}
    return {"t": time} | {part: made[part] for part in parts}


def npz(truth: Truth, path: Path, time: Floats, parts: Sequence[str] = WHOLE) -> Path:
    made: dict[str, Any] = arrays(truth, time, parts) | {"label": np.array(["a", "b"])}
    np.savez_compressed(path, **made)
    return path


def mat(truth: Truth, path: Path, time: Floats, parts: Sequence[str] = WHOLE) -> Path:
    """MATLAB's 5.0, in a structure; columns are times."""
    from scipy.io import savemat

    made = arrays(truth, time, parts).items()
    inside = {name: np.moveaxis(values, 0, -1) for name, values in made}
    savemat(path, {"log": inside, "note": "monday"})
    return path


def hdf5(truth: Truth, path: Path, time: Floats, parts: Sequence[str] = WHOLE) -> Path:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in arrays(truth, time, parts).items():
            file.create_dataset(f"one/{name}", data=values, chunks=True, compression="gzip")
        file["one/note"] = "monday"
    return path


def mat73(truth: Truth, path: Path, time: Floats, parts: Sequence[str] = WHOLE) -> Path:
    """MATLAB's 7.3: an HDF5 file behind a block of 512 bytes, its axes reversed."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in arrays(truth, time, parts).items():
            turned = np.atleast_2d(values).T if values.ndim > 1 else values[None]
            file.create_dataset(f"log/{name}", data=turned)
    content = bytearray(path.read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    path.write_bytes(content)
    return path


def flat(truth: Truth, time: Floats, parts: Sequence[str] = WHOLE) -> dict[str, Floats]:
    """The same as columns (N,), named as a log is that needs no map."""
    points, told = seen(truth, time), truth.commands(time)
    made = {"t": time}
    if MARKERS in parts:
        axes = [(i, n, k, a) for i, n in enumerate(names(truth)) for k, a in enumerate("xyz")]
        made |= {f"{n}.{a}": points[:, i, k] for i, n, k, a in axes}
    if COMMANDED in parts:
        made |= {f"ctrl.{w.name}": told[:, i] for i, w in enumerate(truth.robot.winches)}
    return made


def table(truth: Truth, path: Path, time: Floats, parts: Sequence[str] = WHOLE) -> Path:
    """A table of text, by Python's csv."""
    made = flat(truth, time, parts)
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(made)
        writer.writerows([cell(v, 9) for v in row] for row in zip(*made.values(), strict=True))
    return path


def parquet(truth: Truth, path: Path, time: Floats, parts: Sequence[str] = WHOLE) -> Path:
    import pyarrow as pa
    from pyarrow import parquet as pq

    pq.write_table(pa.table(flat(truth, time, parts) | {"note": ["x"] * len(time)}), path)
    return path


def lerobot(truth: Truth, path: Path, time: Floats, parts: Sequence[str] = WHOLE) -> Path:
    """A data set of two episodes in LeRobot's version 3; the second is the truth."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    points, told = seen(truth, time).reshape(len(time), -1), truth.commands(time)
    n = len(time)
    table = {
        "observation.state": [*np.zeros((50, points.shape[1])), *points],
        "action": [*np.zeros((50, told.shape[1])).astype(np.float64), *told],
        "timestamp": pa.array(np.concatenate([np.arange(50) / RATE, time]), pa.float32()),
        "frame_index": np.concatenate([np.arange(50), np.arange(n)]),
        "episode_index": np.repeat([0, 1], [50, n]),
    }
    if COMMANDED not in parts:
        del table["action"]
    state = [f"{name}.{a}" for name in names(truth) for a in "xyz"]
    info = {
        "codebase_version": "v3.0",
        "fps": int(RATE),
        "features": {
            "observation.state": {"dtype": "float64", "shape": [len(state)], "names": state},
            "action": {
                "dtype": "float64",
                "shape": [told.shape[1]],
                "names": {"motors": [w.name for w in truth.robot.winches]},
            },
        },
    }
    for folder in ("meta", "data/chunk-000"):
        (path / folder).mkdir(parents=True)
    (path / "meta/info.json").write_text(json.dumps(info))
    pq.write_table(pa.table(table), path / "data/chunk-000/file-000.parquet")
    return path


def c3d(truth: Truth, path: Path, time: Floats) -> Path:
    import ezc3d

    points = seen(truth, time) * MM
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [RATE]
    file["parameters"]["POINT"]["LABELS"]["value"] = names(truth)
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    homogeneous = np.ones((4, points.shape[1], len(time)))
    homogeneous[:3] = points.transpose(2, 1, 0)
    file["data"]["points"] = homogeneous
    residuals = np.where(np.isnan(points[..., 0]), -1.0, 0.1).T[None]
    file["data"]["meta_points"]["residuals"] = residuals
    file.write(str(path.with_suffix(".c3d")))
    path.with_suffix(".c3d").rename(path)
    return path


TOPICS = {COMMANDED: "/motors", MARKERS: "/markers"}


def _messages(
    truth: Truth, time: Floats, parts: Sequence[str]
) -> list[tuple[str, float, list[float]]]:
    """Topic, time and numbers of messages."""
    told, points = truth.commands(time), seen(truth, time).reshape(len(time), -1)
    numbers = {COMMANDED: told, MARKERS: points}
    return [
        (topic, now, numbers[part][i].tolist())
        for i, now in enumerate(time.tolist())
        for part, topic in TOPICS.items()
        if part in parts
    ]


def mcap(truth: Truth, path: Path, time: Floats, parts: Sequence[str] = WHOLE) -> Path:
    """Foxglove's, with JSON."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = {
            topic: writer.register_channel(
                topic, "json", writer.register_schema(topic, "jsonschema", b"{}")
            )
            for topic in map(TOPICS.__getitem__, parts)
        }
        for topic, now, values in _messages(truth, time, parts):
            plain = [None if np.isnan(v) else v for v in values]
            stamp = round((EPOCH + now) * 1e9)
            data = json.dumps({"data": plain}).encode()
            writer.add_message(channels[topic], log_time=stamp, data=data, publish_time=stamp)
        writer.finish()
    return path


def bag1(truth: Truth, path: Path, time: Floats, parts: Sequence[str] = WHOLE) -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as writer:
        _write_bag(writer, store, "serialize_ros1", _messages(truth, time, parts))
    return path


def bag2(
    truth: Truth,
    path: Path,
    time: Floats,
    parts: Sequence[str] = WHOLE,
    storage: str = "SQLITE3",
) -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        _write_bag(writer, store, "serialize_cdr", _messages(truth, time, parts))
    return path


def _write_bag(
    writer: Any, store: Any, serialize: str, messages: list[tuple[str, float, list[float]]]
) -> None:
    kind = "std_msgs/msg/Float64MultiArray"
    types = store.types
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    topics = sorted({topic for topic, _, _ in messages}, reverse=True)
    channels = {t: writer.add_connection(t, kind, typestore=store) for t in topics}
    for topic, now, values in messages:
        message = types[kind](layout=layout, data=np.array(values))
        writer.write(
            channels[topic], round((EPOCH + now) * 1e9), getattr(store, serialize)(message, kind)
        )


Writer = Callable[[Truth, Path, Floats], Path]
