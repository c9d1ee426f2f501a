#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" nptdms==1.13.0 numpy==2.4.6
echo "guess:     in a TDMS file to which a second recording was appended, times are those of both recordings"
echo "behaviour: all rows get start and rate of the second, so the first is a day late and twice as long"
python - <<'PYTHON'
from datetime import datetime

import numpy as np
from nptdms import ChannelObject, TdmsFile, TdmsWriter


def recorded(mode, start, step):
    """Four samples appended as one recording, which states its own start and step [s]."""
    properties = {"wf_start_time": start, "wf_start_offset": 0.0, "wf_increment": step}
    with TdmsWriter("log.tdms", mode=mode) as writer:
        writer.write_segment([ChannelObject("robot", "tension", np.arange(4.0), properties=properties)])


def times():
    return [str(time)[8:21] for time in TdmsFile.read("log.tdms")["robot"]["tension"].time_track(absolute_time=True)]


recorded("w", datetime(2026, 1, 1), 0.1)
first = times()
recorded("a", datetime(2026, 1, 2), 0.2)
both = times()
print(f"seen:      day and time of the first recording {first}; with the second {both}")
assert first[-1] == "01T00:00:00.3" and both[0] == "02T00:00:00.0" and both[3] == "02T00:00:00.6" and both[-1] == "02T00:00:01.4", "this has changed"
PYTHON
