"""Files of motion capture, controllers and loggers, read by what is in them: one module per format."""

from flywheel.data.recordings.formats.detection import FORMATS, TABLE, format_of
from flywheel.data.recordings.formats.opening import LogFile, open_log
from flywheel.data.recordings.formats.stream import (
    ANGLES,
    POSITION,
    QUATERNION,
    TIME_NAMES,
    Contents,
    Stream,
    named_time,
)

__all__ = [
    "ANGLES",
    "FORMATS",
    "POSITION",
    "QUATERNION",
    "TABLE",
    "TIME_NAMES",
    "Contents",
    "LogFile",
    "Stream",
    "format_of",
    "named_time",
    "open_log",
]
