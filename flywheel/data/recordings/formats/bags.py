"""ROS 1 bags, and ROS 2 bags as folders, by rosbags: no ROS is needed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flywheel.data.recordings.formats import mcap_files
from flywheel.data.recordings.formats.messages import Topic, contents
from flywheel.data.recordings.formats.stream import Contents
from flywheel.errors import ConfigError, DataError


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. Topics are streams; columns are `/topic.field`."""
    try:
        from rosbags.highlevel import AnyReader  # an extra
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ConfigError("ROS bags need rosbags: install flywheel[formats].") from None
    notes: list[str] = []
    if path.suffix == ".db3" or (
        path.is_file() and path.parent.joinpath("metadata.yaml").is_file()
    ):
        path = path.parent
    topics: dict[str, Topic] = {}
    try:
        # Bags without definitions are of Humble or before.
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            _collect(reader, topics, notes)
    except Exception as error:  # rosbags raises whatever a damaged file leads to
        if isinstance(error, DataError):
            raise
        if not topics and any(path.glob("*.mcap")):  # with JSON beside messages of ROS, or damaged
            return mcap_files.read(path, names)
        if not topics:
            raise DataError(f"it cannot be read: {error}.") from None
        notes.append(f"it ends early: {error}")
    return contents(topics, notes)


def _collect(reader: Any, topics: dict[str, Topic], notes: list[str]) -> None:
    from rosbags.highlevel import AnyReaderError  # an extra

    unread = dict[str, str]()  # topic -> why
    for connection, logged, raw in reader.messages():
        try:
            message = reader.deserialize(raw, connection.msgtype)
        except KeyError:
            unread[connection.topic] = "the bag does not define them"
        except AnyReaderError as error:  # another version's, or damaged
            unread.setdefault(connection.topic, str(error))
        else:
            topics.setdefault(connection.topic, Topic(connection.topic)).add(message, logged)
    notes += [f"messages of {topic} are left out: {why}" for topic, why in sorted(unread.items())]
