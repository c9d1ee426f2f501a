"""C3D files by ezc3d, whose answer is compared with what the file's own header says."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.data.recordings.formats.markers import named
from flywheel.data.recordings.formats.stream import Contents, Stream, metres
from flywheel.errors import ConfigError, DataError

MOST_FRAMES = 65_534  # ezc3d counts no further
LARGEST = 2_000_000_000  # [bytes]
BLOCK = 512  # [bytes], of which a file is made
PARAMETERS = 2 * 255 * BLOCK  # [bytes] within which all parameters end, wherever they begin
DIMENSIONS = 7  # of a parameter, by the format


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. A marker was seen where its residual is not negative; analog channels are left out."""
    try:
        import ezc3d  # an extra
    except ImportError:
        raise ConfigError("C3D needs ezc3d: install flywheel[formats].") from None
    with path.open("rb") as file:
        header, more = file.read(BLOCK), file.read(PARAMETERS)
    _check_header(header, path.stat().st_size)
    try:
        _check_parameters(header + more)
    except (IndexError, struct.error):
        raise DataError("it is damaged: its parameters have no end.") from None
    try:
        content = ezc3d.c3d(str(path))
        return _contents(content, header)
    except (DataError, ConfigError):
        raise
    except Exception as error:  # ezc3d raises whatever a damaged file leads to
        raise DataError(f"it is damaged: {error}.") from None


def _check_header(header: bytes, size: int) -> None:
    """Raises DataError if a header promises more than the file can hold."""
    if len(header) < BLOCK or size > LARGEST:
        raise DataError("it is no C3D file: its header is cut, or it is larger than 2 GB.")
    parameters, _, points, analogs, first, last = struct.unpack("<BBHHHH", header[:10])
    if struct.unpack("<f", header[12:16])[0] == 0 or parameters < 2 or last < first:
        raise DataError("its header is damaged.")
    least = (last - first + 1) * (points * 4 + analogs) * 2
    if least > size:
        raise DataError(f"its header promises {least:,} bytes of frames; the file has {size:,}.")


def _check_parameters(content: bytes) -> None:
    """Raises DataError if a parameter promises more than there is: ezc3d counts through all of it.

    Args:
      content: of the file, up to the end of its parameters.
    """
    at = (content[0] - 1) * BLOCK
    at += 3 + max(1, content[at])
    while length := struct.unpack_from("b", content, at)[0]:  # of a name; negative if it is locked
        group, at = content[at + 1] > 127, at + 2 + abs(length)
        (following,) = struct.unpack_from("<H", content, at)
        sizes = content[at + 4 : at + 4 + content[at + 3]]
        promised = math.prod(max(1, size) for size in sizes)
        if not group and (len(sizes) > DIMENSIONS or promised > len(content) - at):
            raise DataError(
                f"it is damaged: a parameter has {len(sizes)} dimensions and {promised:.3g} values, for "
                f"which there are {len(content) - at:,} bytes."
            )
        if not following:
            return
        at += following


def _contents(content: Any, header: bytes) -> Contents:
    parameters = content["parameters"]
    points = np.asarray(content["data"]["points"])[:3]  # (3, P, N)
    residuals = np.asarray(content["data"]["meta_points"]["residuals"])[0]
    rate, frames = float(_value(parameters, "POINT", "RATE", 0.0)), points.shape[2]
    if not 0 < rate < 1e6 or points.shape[1] == 0:
        raise DataError(f"it has {points.shape[1]} markers at {rate:g} Hz.")
    _check_analog(parameters, header, rate)
    real = _frames(parameters, header)
    if frames > MOST_FRAMES or real > frames:
        raise DataError(
            f"it has {real:,} frames, of which ezc3d reads {frames:,}; at most {MOST_FRAMES:,} are read. "
            "Export it in parts, or as CSV or TRC."
        )
    labels = [label.strip() for label in _labels(parameters)]
    labels += [f"marker {i}" for i in range(len(labels) + 1, points.shape[1] + 1)]
    seen = (residuals >= 0) & np.isfinite(points).all(axis=0)
    places = np.where(seen, points, np.nan)[..., :real]
    found, notes = named(
        [(label, places[:, i].T) for i, label in enumerate(labels[: points.shape[1]])]
    )
    unit = metres(str(_value(parameters, "POINT", "UNITS", "")))
    first = int(content["header"]["points"]["first_frame"])
    if first:
        notes.append(f"its first frame is number {first + 1}: times are from frame 1 on")
    if frames > real:
        notes.append(f"{frames - real} frames of padding at its end are left out")
    time = (first + np.arange(real)) / rate
    return Contents((Stream(found, time, length=unit, asks_unit=unit is None),), tuple(notes))


def _value(parameters: Any, group: str, name: str, default: Any) -> Any:
    values = parameters.get(group, {}).get(name, {}).get("value", [])
    return values[0] if len(values) else default


def _labels(parameters: Any) -> list[str]:
    """Names of the markers: LABELS, LABELS2 and so on, 255 in each."""
    found, number = list(parameters["POINT"].get("LABELS", {}).get("value", [])), 2
    while f"LABELS{number}" in parameters["POINT"]:
        found += list(parameters["POINT"][f"LABELS{number}"]["value"])
        number += 1
    return found


def _frames(parameters: Any, header: bytes) -> int:
    """Number of frames by TRIAL:ACTUAL_END_FIELD, or by the header, which counts to 65,535."""
    ends = [
        parameters.get("TRIAL", {}).get(f"ACTUAL_{name}_FIELD", {}).get("value", [])
        for name in ("START", "END")
    ]
    if all(len(each) for each in ends):
        low, high = (
            sum((int(word) & 0xFFFF) << 16 * i for i, word in enumerate(each[:2])) for each in ends
        )
        if high >= low:
            return high - low + 1
    first, last = struct.unpack("<HH", header[6:10])
    return int(last - first + 1)


def _check_analog(parameters: Any, header: bytes, rate: float) -> None:
    """Raises DataError where ezc3d takes another number of analog samples per frame than the file has."""
    channels, per_frame = struct.unpack("<H", header[4:6])[0], struct.unpack("<H", header[18:20])[0]
    analog = float(_value(parameters, "ANALOG", "RATE", 0.0))
    if channels and per_frame and int(analog / rate) != per_frame:
        raise DataError(
            f"its analog channels have {analog / rate:.6g} samples per frame by their rates and {per_frame} "
            "by its header, which ezc3d misreads. Export it without analog channels, or as CSV or TRC."
        )
