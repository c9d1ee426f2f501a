#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" lmfit==1.3.4 numpy==2.4.6 scipy==1.17.1
echo "guess:     a fit that starts at a bound, as a full battery or a closed valve does, ends where one ends that starts beside it"
echo "behaviour: from an upper bound it ends elsewhere, with \"Fit succeeded.\"; from a lower one, or 0.001 beside it, it is right"
python - <<'PYTHON'
import lmfit
import numpy as np

times = np.linspace(0, 3, 50)
decay = 2 * np.exp(-0.7 * times)


def fitted(start, largest):
    """The two numbers of a decay without noise, and the message."""
    parameters = lmfit.create_params(size=1.0, rate={"value": start, "min": 0.0, "max": largest})
    result = lmfit.minimize(lambda p: p["size"] * np.exp(-p["rate"] * times) - decay, parameters)
    return round(result.params["size"].value, 3), round(result.params["rate"].value, 3), result.success, result.message


seen = {(start, largest): fitted(start, largest) for start, largest in ((3.0, 3.0), (10.0, 10.0), (2.999, 3.0), (0.0, 3.0))}
print(f"seen:      size 2 and rate 0.7, by start of the rate and its bound: {seen}")
for (start, largest), (size, rate, success, message) in seen.items():
    assert success and message == "Fit succeeded.", "this has changed"
    assert abs(rate - 0.7) > 0.05 if start == largest else (size, rate) == (2.0, 0.7), "this has changed"
PYTHON
