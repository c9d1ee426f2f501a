#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mcap==1.6.0
echo "guess:     iter_messages(reverse=True) begins with the latest message of every MCAP file"
echo "behaviour: where a file has no chunk index, as the format allows, it begins with the first, and says nothing"
python - <<'PYTHON'
from mcap.reader import make_reader
from mcap.writer import IndexType, Writer


def times(**options):
    """Times [ns] of three messages of a file that was written with these options, read backward."""
    with open("log.mcap", "wb") as file:
        writer = Writer(file, **options)
        writer.start()
        schema = writer.register_schema("x", "jsonschema", b"{}")
        channel = writer.register_channel("/x", "json", schema)
        for now in (10, 20, 30):
            writer.add_message(channel, now, b"0", now)
        writer.finish()
    with open("log.mcap", "rb") as file:
        return [message.log_time for _, _, message in make_reader(file).iter_messages(reverse=True)]


indexed, plain, unchunked = times(), times(index_types=IndexType.NONE), times(use_chunking=False)
print(f"seen:      {indexed} with an index, {plain} without, {unchunked} without chunks")
assert indexed == [30, 20, 10] and plain == unchunked == [10, 20, 30], "this has changed"
PYTHON
