"""MCAP files, also those cut by a power loss: messages of ROS 1, of ROS 2 and JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from flywheel.data.recordings.formats.messages import Topic, contents
from flywheel.data.recordings.formats.stream import Contents
from flywheel.errors import ConfigError, DataError


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. Topics are streams; columns are `/topic.field`; files of a folder are one recording."""
    topics: dict[str, Topic] = {}
    notes: list[str] = []
    left: set[str] = set()
    for each in sorted(path.glob("*.mcap")) if path.is_dir() else [path]:
        try:
            _collect(each, topics, left)
        except ImportError:
            raise ConfigError("MCAP needs mcap: install flywheel[formats].") from None
        except Exception as error:  # the decoders raise whatever a damaged file leads to
            if isinstance(error, DataError):
                raise
            if not topics:
                raise DataError(f"it cannot be read: {error}.") from None
            notes.append(f"it ends early, what was written before is used: {error}")
    return contents(topics, notes + sorted(left))


def _collect(path: Path, topics: dict[str, Topic], left: set[str]) -> None:
    """Append the messages of a file to their topics; `left` names topics of other encodings."""
    from mcap.reader import NonSeekingReader  # an extra
    from mcap_ros1.decoder import DecoderFactory as Ros1
    from mcap_ros2.decoder import DecoderFactory as Ros2

    decoders: dict[int, Any] = {}
    with path.open("rb") as file:
        for schema, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            if channel.id not in decoders:
                decoders[channel.id] = _decoder(schema, channel, (Ros1(), Ros2()))
            if decoders[channel.id] is None:
                left.add(
                    f"{channel.topic} is left out: its messages are {channel.message_encoding!r}"
                )
                continue
            decoded = decoders[channel.id](message.data)
            topics.setdefault(channel.topic, Topic(channel.topic)).add(decoded, message.log_time)


def _decoder(schema: Any, channel: Any, factories: tuple[Any, ...]) -> Any:
    """Decoder of a channel's messages; None without one."""
    if channel.message_encoding == "json":
        return json.loads
    for factory in factories:
        found = factory.decoder_for(channel.message_encoding, schema)
        if found is not None:
            return found
    return None
