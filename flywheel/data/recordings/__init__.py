"""Logs of real robots: CSV files that become episodes, and back."""

from flywheel.data.recordings.guessing import guess
from flywheel.data.recordings.joining.alignment import Aligned
from flywheel.data.recordings.mapping import RecordingMap, Units, read_map
from flywheel.data.recordings.reading import Imported, read_recording
from flywheel.data.recordings.report import Finding, ImportReport, counted
from flywheel.data.recordings.storing import store_recording, stored_recordings
from flywheel.data.recordings.tables.table import Told
from flywheel.data.recordings.writing import write_recording

__all__ = [
    "Aligned",
    "Finding",
    "ImportReport",
    "Imported",
    "RecordingMap",
    "Told",
    "Units",
    "counted",
    "guess",
    "read_map",
    "read_recording",
    "store_recording",
    "stored_recordings",
    "write_recording",
]
