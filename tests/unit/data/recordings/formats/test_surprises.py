"""Where readers of formats do not do what one would guess, the numbers are right or the file is refused."""

import json
import re
import sqlite3
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from flywheel.data.recordings.formats import Stream, open_log
from flywheel.errors import DataError

# [ns] since 1970, beyond the whole numbers that a float64 can count.
NOW = 1_760_000_000_000_000_000
STEP = 10_000_000  # [ns]


def only(path: Path) -> Stream:
    (stream,) = open_log(path).streams
    return stream


def c3d(
    path: Path,
    frames: int,
    units: str | None = "mm",
    count: int = 2,
    first: int = 0,
    analog: int = 0,
) -> Path:
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [29.97 if analog else 100.0]
    labels = ["a  ", "b", *(f"m{i}" for i in range(2, count))]
    file["parameters"]["POINT"]["LABELS"]["value"] = labels
    file["parameters"]["POINT"]["UNITS"]["value"] = [units] if units else []
    if first:
        file["header"]["points"]["first_frame"] = first
        file["header"]["points"]["last_frame"] = first + frames - 1
    if analog:
        file["parameters"]["ANALOG"]["RATE"]["value"] = [29.97 * analog]
        file["parameters"]["ANALOG"]["LABELS"]["value"] = ["volts"]
        file["data"]["analogs"] = np.ones((1, 1, frames * analog))
    points = np.ones((4, count, frames)) * np.arange(1, count + 1)[:, None]
    points[0] = np.arange(frames)
    points[:3, 1, 2] = np.nan
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = np.zeros((1, count, frames))
    file.write(str(path))
    return path


def test_a_nan_in_a_c3d_was_not_seen_though_its_residual_is_0(tmp_path: Path) -> None:
    stream = only(c3d(tmp_path / "a.c3d", 10))
    assert list(stream.columns) == [
        "a.x",
        "a.y",
        "a.z",
        "b.x",
        "b.y",
        "b.z",
    ]  # labels without padding
    assert np.isnan(stream.columns["b.x"][2])
    np.testing.assert_array_equal(stream.columns["a.x"], np.arange(10.0))
    assert (stream.length, stream.asks_unit) == ("mm", False)


def test_a_c3d_without_a_unit_asks_for_it(tmp_path: Path) -> None:
    assert only(c3d(tmp_path / "a.c3d", 10, units=None)).asks_unit


def test_a_c3d_of_300_markers_has_the_names_of_all(tmp_path: Path) -> None:
    columns = only(c3d(tmp_path / "a.c3d", 3, count=300)).columns
    assert len(columns) == 900
    np.testing.assert_array_equal(columns["m299.y"], [300.0, 300.0, 300.0])


def test_a_c3d_that_begins_later_says_which_frame_its_times_count_from(tmp_path: Path) -> None:
    found = open_log(c3d(tmp_path / "a.c3d", 10, first=500))
    assert found.streams[0].time is not None
    np.testing.assert_allclose(found.streams[0].time, 5.0 + 0.01 * np.arange(10))
    assert found.notes == ("its first frame is number 501: times are from frame 1 on",)


def test_a_c3d_whose_markers_its_reader_would_garble_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="30 samples per frame by their rates and 30 by its header"):
        open_log(c3d(tmp_path / "a.c3d", 10, analog=30))


def test_times_of_lerobot_are_frames_by_its_rate_after_an_hour_too(tmp_path: Path) -> None:
    frames = np.arange(108_000, 108_005)
    stamps = (frames / 30).astype(np.float32)
    assert np.ptp(np.diff(stamps)) > 1e-4
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"fps": 30, "features": {}}))
    table = {"frame_index": frames, "timestamp": stamps, "action": [[1.5]] * 5}
    (tmp_path / "data").mkdir()
    parquet.write_table(pa.table(table), tmp_path / "data" / "file-000.parquet")
    found = only(tmp_path)
    assert found.time is not None
    np.testing.assert_allclose(found.time, frames / 30, rtol=0, atol=1e-9)


def test_a_c3d_of_more_frames_than_are_counted_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"65,53\d"):
        open_log(c3d(tmp_path / "a.c3d", 70_000))


def test_a_c3d_whose_parameter_promises_more_than_the_file_has_is_not_given_to_its_reader(
    tmp_path: Path,
) -> None:
    path = c3d(tmp_path / "a.c3d", 10)
    content = bytearray(path.read_bytes())
    sizes = (
        content.index(b"LABELS") + len("LABELS") + 4
    )  # after the next one's place, type and number
    content[sizes : sizes + 2] = 255, 255
    path.write_bytes(content)
    with pytest.raises(
        DataError, match=r"2 dimensions and 6.5e\+04 values, for which there are \d,"
    ):
        open_log(path)


def test_matlabs_whole_numbers_and_logicals_are_numbers(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(
        tmp_path / "a.mat",
        {"u": np.array([10, 250, 3], np.uint8), "seen": np.array([True, False, True])},
    )
    columns = only(tmp_path / "a.mat").columns
    np.testing.assert_array_equal(np.diff(columns["u"]), [240.0, -247.0])
    np.testing.assert_array_equal(columns["seen"], [1.0, 0.0, 1.0])


def test_arrays_of_matlab_7_3_are_turned_and_empty_ones_left_out(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["log/t"] = 0.01 * np.arange(5)[None]
        file["log/x"] = np.arange(10.0).reshape(2, 5)  # MATLAB's 5 x 2
        file["log/empty"] = np.array([0, 0], np.uint64)
        file["log/empty"].attrs["MATLAB_empty"] = 1
    content = bytearray(path.read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    path.write_bytes(content)
    found = open_log(path)
    (stream,) = found.streams
    assert set(stream.columns) == {"log.t", "log.x[0]", "log.x[1]"}
    np.testing.assert_array_equal(stream.columns["log.x[1]"], [5, 6, 7, 8, 9])
    assert found.notes == ("'log/empty' is left out: it has no numbers of its own",)


@pytest.mark.parametrize("between", ["\t", ","])
def test_an_unseen_marker_of_a_trc_does_not_move_the_next_into_its_cells(
    between: str, tmp_path: Path
) -> None:
    rows = ["1\t0.000\t\t\t\t4\t5\t6", "2\t0.008\t1\t2\t3\t4\t5\t6", "3\t0.017\t1\t2\t3\t\t\t"]
    head = [
        "PathFileType\t4\t(X/Y/Z)\ta.trc", "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
        "119.88\t119.88\t3\t2\tmm", "Frame#\tTime\ta\t\t\tb", "\t\tX1\tY1\tZ1\tX2\tY2\tZ2", "\t\t\t\t\t\t\t",
    ]  # fmt: skip
    (tmp_path / "a.txt").write_text("\n".join(head + rows).replace("\t", between) + "\n")
    stream = only(tmp_path / "a.txt")
    np.testing.assert_array_equal(stream.columns["a.x"], [np.nan, 1.0, 1.0])
    np.testing.assert_array_equal(stream.columns["b.x"], [4.0, 4.0, np.nan])
    assert stream.time is not None
    np.testing.assert_allclose(stream.time, np.arange(3) / 119.88)


def mcap(path: Path, order: list[int]) -> Path:
    writer_of = pytest.importorskip("mcap.writer").Writer
    with path.open("wb") as file:
        writer = writer_of(file, chunk_size=200)
        writer.start()
        channel = writer.register_channel(
            "/a", "json", writer.register_schema("a", "jsonschema", b"{}")
        )
        for i in order:
            data = json.dumps({"x": i, "names": ["p", "q"], "v": [i, -i]}).encode()
            writer.add_message(channel, log_time=i * 10**7, data=data, publish_time=0)
        writer.finish()
    return path


def test_messages_that_were_written_out_of_order_are_in_the_order_of_their_times(
    tmp_path: Path,
) -> None:
    stream = only(mcap(tmp_path / "a.bin", [0, 2, 1, 3]))
    np.testing.assert_array_equal(stream.columns["/a.x"], np.arange(4.0))
    np.testing.assert_array_equal(stream.columns["/a.v[q]"], -np.arange(4.0))


def test_a_recording_that_was_cut_gives_what_was_written(tmp_path: Path) -> None:
    path = mcap(tmp_path / "a.bin", list(range(100)))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 3])
    found = open_log(path)
    count = len(found.streams[0].columns["/a.x"])
    assert 5 < count < 100
    np.testing.assert_array_equal(found.streams[0].columns["/a.x"], np.arange(float(count)))
    assert any("ends early" in note for note in found.notes)


def test_a_lerobot_file_that_was_not_closed_is_told_so(tmp_path: Path) -> None:
    (tmp_path / "a.parquet").write_bytes(b"PAR1" + bytes(200))
    with pytest.raises(DataError, match="finalize"):
        open_log(tmp_path / "a.parquet")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"comment,Tracking Tools\ninfo,version,1.1\n", "old Tracking Tools"),
        (b"\x1f\x8b" + bytes(20), "gzip"),
        (b"PK\x03\x04" + bytes(40), "ZIP archive or a spreadsheet"),
        (b"\x00\x01\x02" * 20, "neither text nor of a format that is read: Motive CSV"),
        (b"Format Version,1.23\n\n1,2,3\n", "no row begins with 'Frame'"),
        (b"MATLAB 5.0 MAT-file" + bytes(200), "MAT"),
        (b"\x02\x50" + bytes(600), "header"),
        (b"NO_OF_FRAMES\t3\n", "MARKER_NAMES"),
    ],
)
def test_a_file_that_is_not_read_is_told_why(content: bytes, words: str, tmp_path: Path) -> None:
    if content[1:2] == b"\x50":
        pytest.importorskip("ezc3d")
    (tmp_path / "a.dat").write_bytes(content)
    with pytest.raises(DataError, match=words):
        open_log(tmp_path / "a.dat")


def test_nanoseconds_and_durations_of_parquet_are_times(tmp_path: Path) -> None:
    stamps = NOW + STEP * np.arange(5)
    table = {
        "stamp": stamps,
        "unsigned": stamps.astype(np.uint64),
        "since": pa.array(STEP * np.arange(5), pa.duration("ns")),
        "milliseconds": pa.array(10 * np.arange(5), pa.duration("ms")),
        "date": pa.array(stamps, pa.timestamp("ns")),
        "far": pa.array([253_402_300_799] * 5, pa.timestamp("s")),  # the year 9999
        "x": pa.array([1.0, None, np.nan, 4.0, 5.0]),
    }
    parquet.write_table(pa.table(table), tmp_path / "log.parquet")
    found = only(tmp_path / "log.parquet").columns
    for name in ("stamp", "unsigned"):
        np.testing.assert_array_equal(found[name], stamps.astype(float))
    np.testing.assert_allclose(found["since"], 0.01 * np.arange(5))
    np.testing.assert_allclose(found["milliseconds"], 0.01 * np.arange(5))
    np.testing.assert_allclose(found["date"] - NOW / 1e9, 0.01 * np.arange(5), atol=3e-7)
    assert found["far"][0] == 253_402_300_799
    np.testing.assert_array_equal(found["x"], [1, np.nan, np.nan, 4, 5])


def test_an_hdf5_array_has_the_name_of_each_link_to_it(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["y"] = np.zeros(5)
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["clock/t"] = 0.01 * np.arange(5)
        file["motor/torque"] = np.arange(5.0)
        file["motor/t"] = file["clock/t"]
        file["camera/t"] = h5py.SoftLink("/clock/t")
        file["camera/own"] = h5py.SoftLink("t")
        file["same"] = h5py.SoftLink("/motor")
        file["motor/up"] = h5py.SoftLink("/")
        file["nowhere"] = h5py.SoftLink("/none")
        file["other"] = h5py.ExternalLink("other.h5", "/y")
    found = only(tmp_path / "log.h5").columns
    times = {"clock/t", "motor/t", "camera/t", "camera/own", "same/t"}
    assert set(found) == times | {"motor/torque", "same/torque"}
    for name in times:
        np.testing.assert_array_equal(found[name], 0.01 * np.arange(5))
    np.testing.assert_array_equal(found["same/torque"], np.arange(5.0))


@pytest.mark.parametrize("distribution", ["ROS2_FOXY", "ROS2_HUMBLE"])
def test_a_bag_without_definitions_is_read_message_by_message(
    distribution: str, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores[distribution])
    make = {name.split("/")[-1]: kind for name, kind in store.types.items()}
    with Writer(tmp_path / "bag", version=9) as writer:
        ranges, numbers, others = (
            writer.add_connection(f"/{name}", kind, typestore=store)
            for name, kind in (
                ("range", "sensor_msgs/msg/Range"),
                ("x", "std_msgs/msg/Float64"),
                ("other", "sensor_msgs/msg/Range"),
            )
        )
        for i in range(3):
            header = make["Header"](stamp=make["Time"](sec=5, nanosec=i), frame_id="a")
            seen = make["Range"](header, 0, 0.1, 0.0, 4.0, 1.5 + i)
            number = store.serialize_cdr(make["Float64"](float(i)), numbers.msgtype)
            writer.write(others, 10 * i, number)  # not what its topic says
            writer.write(ranges, 10 * i, store.serialize_cdr(seen, ranges.msgtype))
            writer.write(numbers, 10 * i, number)
    with sqlite3.connect(next((tmp_path / "bag").glob("*.db3"))) as bag:  # as Humble wrote it
        bag.execute("DROP TABLE message_definitions")
        bag.execute("ALTER TABLE topics DROP COLUMN type_description_hash")
        bag.execute("UPDATE schema SET schema_version = 3")
    read = open_log(tmp_path / "bag")
    found = {name: values for stream in read.streams for name, values in stream.columns.items()}
    np.testing.assert_array_equal(found["/x.data"], [0, 1, 2])
    np.testing.assert_array_equal(found["/range.range"], [1.5, 2.5, 3.5])
    assert [note.split(":")[0] for note in read.notes] == ["messages of /other are left out"]


def test_numbers_that_may_have_been_nan_are_told(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    heights = np.array([2.0, 1.5, np.nan, 3.0])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, filters in (("plain", {}), ("rounded", {"scaleoffset": 3})):
            file.create_dataset(name, data=heights, chunks=(4,), **filters)
        file.create_dataset("counts", data=np.arange(4), chunks=(4,), scaleoffset=0)
    read = open_log(tmp_path / "a.h5")
    assert [note.split(" was saved with ")[0] for note in read.notes] == ["'rounded'"]
    (stream,) = read.streams
    np.testing.assert_array_equal(stream.columns["plain"], heights)
    np.testing.assert_allclose(stream.columns["rounded"], [2.0, 1.5, 1.5, 3.0])


def test_variables_of_netcdf_have_equally_many_rows_and_are_not_packed(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    unwritten = 9.969209968386869e36  # what netCDF says where nothing was written
    with h5py.File(tmp_path / "a.nc", "w") as file:
        file.attrs["_NCProperties"] = np.bytes_("version=2")
        file["time"] = np.arange(4)
        file["time"].attrs["units"] = np.bytes_("milliseconds since 2026-01-01")
        file["axis"] = np.zeros(2)
        file["alone"] = 5.0
        file["count"] = np.array([0, 1, 0, 2])
        file.create_dataset("height", data=np.array([0, -1, 500], np.int16), fillvalue=-1)
        file["height"].attrs.update({"scale_factor": [0.001], "add_offset": 1.5})
        file.create_dataset("force", data=[1.0, unwritten, 0.0, -9.0], fillvalue=unwritten)
        file["force"].attrs.update({"missing_value": -9.0, "units": "N since the last stop"})
        file.create_dataset("point", data=np.ones((3, 2)))
        for name, kind in (
            ("time", "time"),
            ("axis", "This is a netCDF dimension but not a netCDF variable"),
        ):
            file[name].make_scale(kind)
        for name in ("count", "height", "force", "point"):
            file[name].dims[0].attach_scale(file["time"])
        file["point"].dims[1].attach_scale(file["axis"])
    read = open_log(tmp_path / "a.nc")
    (stream,) = read.streams
    expected = {
        "time": [0.0, 0.001, 0.002, 0.003],
        "count": [0, 1, 0, 2],
        "height": [1.5, np.nan, 2.0, np.nan],
        "force": [1.0, np.nan, 0.0, np.nan],
        "point[0]": [1, 1, 1, np.nan],
        "point[1]": [1, 1, 1, np.nan],
    }
    assert set(stream.columns) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(stream.columns[name], values, err_msg=name)
    assert read.notes == ("'axis' is left out: it has no numbers of its own",)


def test_a_netcdf_that_would_be_far_larger_than_it_is_is_refused(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.nc", "w") as file:
        file.attrs["_NCProperties"] = np.bytes_("version=2")
        file["time"] = np.zeros(200_000, np.int8)
        file["time"].make_scale("time")
        file["wide"] = np.zeros((1, 1_000), np.int8)
        file["wide"].dims[0].attach_scale(file["time"])
    with pytest.raises(DataError, match="200,200,000 numbers"):
        open_log(tmp_path / "a.nc")


def test_padding_at_the_end_of_a_c3d_is_no_frame(tmp_path: Path) -> None:
    path = c3d(tmp_path / "a.c3d", 10)
    path.write_bytes(path.read_bytes() + bytes(512))
    found = open_log(path)
    np.testing.assert_array_equal(found.streams[0].columns["a.x"], np.arange(10.0))


def bag(path: Path, times: list[int], numbers: np.ndarray) -> Path:
    """A ROS 2 bag of lists, at times [ns]."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind, layout = "std_msgs/msg/Float64MultiArray", "std_msgs/msg/MultiArrayLayout"
    with Writer(path, version=9) as writer:
        channel = writer.add_connection("/x", kind, typestore=store)
        for time, number in zip(times, numbers, strict=True):
            message = store.types[kind](store.types[layout]([], 0), numbers[:0] + 0)
            message.data = np.array([number, number], numbers.dtype)
            writer.write(channel, time, store.serialize_cdr(message, kind))
    return path


def test_files_of_a_split_bag_that_overlap_are_in_the_order_of_their_times(tmp_path: Path) -> None:
    whole = bag(tmp_path / "a", [10, 30, 50], np.array([1.0, 3.0, 5.0]))
    other = bag(tmp_path / "b", [20, 40], np.array([2.0, 4.0]))
    (other / "b.db3").rename(whole / "b.db3")
    about = (whole / "metadata.yaml").read_text()
    both = re.sub(r"( *)- a.db3", r"\1- a.db3\n\1- b.db3", about)
    assert both.count("b.db3") == 1
    (whole / "metadata.yaml").write_text(both)
    np.testing.assert_array_equal(only(whole).columns["/x.data[0]"], [1, 2, 3, 4, 5])


def test_whole_numbers_that_were_written_as_the_bits_of_fractions_are_refused(
    tmp_path: Path,
) -> None:
    with pytest.raises(DataError, match="below 1e-307: were whole numbers written into a field"):
        open_log(bag(tmp_path / "a", [10, 20], np.array([1, 2], np.int64)))


def test_json_beside_messages_of_ros_in_a_bag_is_read(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    (tmp_path / "bag").mkdir()
    mcap(tmp_path / "bag" / "bag_0.mcap", [0, 1, 2])
    lines = [
        "rosbag2_bagfile_information:", "  version: 9", "  storage_identifier: mcap",
        "  duration: {nanoseconds: 20000000}", "  starting_time: {nanoseconds_since_epoch: 0}",
        "  message_count: 3", "  compression_format: ''", "  compression_mode: ''",
        "  relative_file_paths: [bag_0.mcap]", "  files: []", "  topics_with_message_count:",
        "  - message_count: 3", "    topic_metadata: {name: /a, type: a, serialization_format: json, "
        "offered_qos_profiles: [], type_description_hash: ''}",
    ]  # fmt: skip
    (tmp_path / "bag" / "metadata.yaml").write_text("\n".join(lines) + "\n")
    np.testing.assert_array_equal(only(tmp_path / "bag").columns["/a.x"], [0.0, 1.0, 2.0])


@pytest.mark.parametrize("version", ["6.1_SOL2", "6.5.1_GLNX86", "7.1_GLNX86", "7.4_GLNX86"])
def test_arrays_that_matlab_wrote_have_its_numbers(version: str) -> None:
    import scipy.io.matlab

    folder = Path(scipy.io.matlab.__file__).parent / "tests" / "data"
    if not folder.exists():
        pytest.skip("SciPy came without its tests' files")
    angles = only(folder / f"testdouble_{version}.mat").columns["testdouble"]
    np.testing.assert_array_equal(angles, np.pi / 4 * np.arange(9))
    layers = only(folder / f"test3dmatrix_{version}.mat").columns
    assert len(layers) == 6
    for i, j in np.ndindex(2, 3):
        found = layers[f"test3dmatrix[{i}][{j}]"]
        np.testing.assert_array_equal(found, 1 + i + 2 * j + 6 * np.arange(4))


def test_dates_fields_and_commands_between_measurements_of_numpy(tmp_path: Path) -> None:
    days = np.datetime64("2026-12-01T10:00:00", "ms") + np.array([0, 10, 20], "m8[ms]")
    days[1] = np.datetime64("NaT")
    kind = np.dtype([("x", "f4"), ("inner", [("y", "i2")])])
    rows = np.array([(1.5, (2,)), (2.5, (3,)), (3.5, (4,))], kind)
    told = np.arange(4.0).reshape(2, 2)
    np.savez(path := tmp_path / "log.npz", time=days, log=rows, told=told, short=np.arange(1.0))
    file = open_log(path)
    (stream,) = file.streams
    found = {name: values.tolist() for name, values in stream.columns.items()}
    assert stream.columns["time"][2] - stream.columns["time"][0] == pytest.approx(0.02, abs=1e-6)
    assert np.isnan(stream.columns["time"][1])
    assert found["log.x"] == [1.5, 2.5, 3.5] and found["log.inner.y"] == [2, 3, 4]
    assert found["told[1]"][:2] == [1, 3] and np.isnan(found["told[1]"][2])
    assert "'told' has no last row, as commands between measurements" in file.notes


def test_structures_and_times_of_day_of_parquet(tmp_path: Path) -> None:
    rows = [{"x": 1.0, "inner": {"y": 2}}, {"x": 3.0, "inner": {"y": 4}}]
    for unit, kind in (("ms", pa.time32("ms")), ("us", pa.time64("us"))):
        times = pa.array([36_000, 36_001], pa.int32() if unit == "ms" else pa.int64())
        table = pa.table({"time": times.cast(kind), "m": rows})
        parquet.write_table(table, path := tmp_path / f"{unit}.parquet")
        (stream,) = open_log(path).streams
        step = {"ms": 1e-3, "us": 1e-6}[unit]
        assert np.diff(stream.columns["time"]) == pytest.approx(step)
        assert stream.columns["m.inner.y"].tolist() == [2, 4]
        assert stream.columns["m.x"].tolist() == [1, 3]


@pytest.mark.parametrize("every", [1, 2])
def test_a_row_that_a_trc_file_lacks_moves_no_other(every: int, tmp_path: Path) -> None:
    """At 1 kHz, times that are rounded to 1 ms would fit a step early; frames may be those of cameras."""
    head = "PathFileType\t4\t(X/Y/Z)\tx.trc\nDataRate\tNumFrames\tUnits\n1000\t39\tmm\n"
    head += "Frame#\tTime\tm\t\t\n\t\tX1\tY1\tZ1\n"
    frames = [k for k in range(40) if k != 20 or every > 1]
    rows = "".join(f"{1 + every * k}\t{k / 1000:.3f}\t1\t2\t3\n" for k in frames)
    (tmp_path / "log.trc").write_text(head + rows)
    (stream,) = open_log(tmp_path / "log.trc").streams
    assert stream.time is not None
    np.testing.assert_allclose(stream.time, np.array(frames) / 1000, atol=1e-9)
