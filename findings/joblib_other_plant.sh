#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" joblib==1.6.0
echo "guess:     two plants that one function makes, one soft and one stiff, each keep their own results in a joblib Memory"
echo "behaviour: a result belongs to the source text and the arguments: the stiff plant gets the soft one's, without a warning"
cat > plants.py <<'PYTHON'
def plant(stiffness, memory):
    @memory.cache
    def stretch(force):
        return force / stiffness

    return stretch
PYTHON
python -W error - <<'PYTHON'
import joblib
from plants import plant

memory = joblib.Memory("results", verbose=0)
soft, stiff = plant(100.0, memory), plant(400.0, memory)
first, second = soft(10.0), stiff(10.0)
other = joblib.Memory("others", verbose=0)
alone, later = plant(400.0, other)(10.0), plant(100.0, other)(10.0)
print(f"seen:      stretches by 10 N, 100 and 400 N/m: {first} and {second} m; the stiff one first: {later} and {alone} m")
assert (first, second) == (0.1, 0.1) and (later, alone) == (0.025, 0.025), "this has changed"
PYTHON
