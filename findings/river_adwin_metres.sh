#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" river==0.26.1 numpy==2.4.6
echo "guess:     ADWIN notices that errors have grown threefold as soon in metres as in millimetres, as only delta is chosen"
echo "behaviour: its bound has a part with a unit: in millimetres it takes 16 errors, in metres 600 where they grow from 1 to 3 cm, and from 1 to 3 mm they are never noticed"
python - <<'PYTHON'
import numpy as np
from river.drift import ADWIN

random = np.random.default_rng(0)
shape = np.abs(np.concatenate([random.normal(0, 1, 2000), random.normal(0, 3, 2000)]))


def noticed(errors):
    """How many errors after the 2000 ADWIN notices that they have grown, None if it never does."""
    detector = ADWIN()
    for number, error in enumerate(errors):
        detector.update(float(error))
        if detector.drift_detected:
            return number - 1999
    return None


found = {f"{size:g} {unit}": noticed(shape * size) for size, unit in ((10, "mm"), (1, "mm"), (0.01, "m"), (0.001, "m"))}
print(f"seen:      errors until it notices, by their deviation before they grow threefold: {found}")
assert 0 < found["10 mm"] < 100 and 0 < found["1 mm"] < 100, "this has changed"
assert found["0.01 m"] > 300 and found["0.001 m"] is None, "this has changed"
PYTHON
