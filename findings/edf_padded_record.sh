#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pyEDFlib==0.1.42 numpy==2.4.6
echo "guess:     a signal of 10.5 s that write_edf wrote has 10.5 s; if its rate is no whole number, too"
echo "behaviour: the last record is filled up with zeros, and where the rate is no whole number records are long: 9 s at 119.88 Hz become 25 s"
python - <<'PYTHON'
import numpy as np
from pyedflib import highlevel

for rate, count, length in ((100, 1050, 1100), (119.88, 1079, 2997)):
    force = 20 + np.sin(np.arange(count) / 10)
    header = highlevel.make_signal_header("force", dimension="N", sample_frequency=rate, physical_min=-50, physical_max=50)
    highlevel.write_edf("log.edf", [force], [header])
    (read,), (again,), _ = highlevel.read_edf("log.edf")
    print(f"seen:      {count} samples at {rate} Hz became {len(read)} at {again['sample_frequency']} Hz, the last is {read[-1]:.3f} N")
    assert len(read) == length and abs(read[:count] - force).max() < 0.01 and abs(read[count:]).max() < 0.01, "this has changed"
PYTHON
