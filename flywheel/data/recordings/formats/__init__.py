"""Files of motion capture, controllers and loggers, read by what is in them: one module per format."""

from flywheel.data.recordings.formats.detection import FORMATS, TABLE, format_of
from flywheel.data.recordings.formats.opening import LogFile, open_log
from flywheel.data.recordings.formats.stream import ANGLES, POSITION, QUATERNION, Contents, Stream

__all__ = [
    "ANGLES",
    "FORMATS",
    "POSITION",
    "QUATERNION",
    "TABLE",
    "Contents",
    "LogFile",
    "Stream",
    "format_of",
    "open_log",
]
