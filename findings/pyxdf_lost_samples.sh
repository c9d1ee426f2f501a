#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pyxdf==1.17.5 numpy==2.4.6
echo "guess:     load_xdf gives samples about the times at which they were stamped: after 2 s of lost samples the others are where they were"
echo "behaviour: it lays one straight line through all stamps, over gaps of up to 5 s at 100 Hz: times are off by 1 s, and the gap is gone"
python - <<'PYTHON'
import struct

import numpy as np
import pyxdf

RATE, HEAD = 100, '<?xml version="1.0"?><info>'


def chunk(tag, content):
    return struct.pack("<BIH", 4, len(content) + 2, tag) + content


def write(path, stamps):
    """One stream of the format's specification, with a stamp on each sample."""
    header = f"{HEAD}<name>load cell</name><type>Force</type><channel_count>1</channel_count>"
    header += f"<nominal_srate>{RATE}</nominal_srate><channel_format>double64</channel_format></info>"
    footer = f"{HEAD}<first_timestamp>{stamps[0]}</first_timestamp><last_timestamp>{stamps[-1]}</last_timestamp>"
    footer += f"<sample_count>{len(stamps)}</sample_count></info>"
    stream = struct.pack("<I", 1)
    samples = b"".join(struct.pack("<Bdd", 8, stamp, 20.0) for stamp in stamps)
    offsets = b"".join(chunk(4, stream + struct.pack("<dd", stamp, 0.0)) for stamp in range(0, 31, 5))
    with open(path, "wb") as file:
        file.write(b"XDF:" + chunk(1, f"{HEAD}<version>1.0</version></info>".encode()) + chunk(2, stream + header.encode()))
        file.write(chunk(3, stream + struct.pack("<BI", 4, len(stamps)) + samples) + offsets + chunk(6, stream + footer.encode()))


times = np.arange(30 * RATE) / RATE
for gap, wrong in ((0, False), (2, True), (6, False)):
    stamps = times[(times < 10) | (times >= 10 + gap)]
    write("log.xdf", stamps)
    (stream,), _ = pyxdf.load_xdf("log.xdf")
    read = stream["time_stamps"]
    off, step = abs(read - stamps).max(), np.diff(read).max()
    print(f"seen:      a gap of {gap} s: times off by up to {off:.3f} s, largest step {step:.3f} s")
    assert (off > 1 and step < 0.02) == wrong and (off < 1e-6) != wrong, "this has changed"
PYTHON
