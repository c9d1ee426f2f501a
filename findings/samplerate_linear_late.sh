#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" samplerate==0.2.4 numpy==2.4.6
echo "guess:     a ramp that is resampled from 100 to 120 Hz has at each time the value it had, whatever the converter"
echo "behaviour: the converters linear and zero_order_hold are one sample of the input late, here 10 ms; the sinc ones are not"
python - <<'PYTHON'
import numpy as np
import samplerate

times = np.arange(1000) / 100
late = {}
for converter in ("sinc_best", "sinc_fastest", "linear", "zero_order_hold"):
    found = samplerate.resample(times, 1.2, converter)[120:1080]
    late[converter] = float(np.median((np.arange(120, 1080) / 120 - found) * 1000))
halves = samplerate.resample(times, 0.5, "linear")[50:450]
print(f"seen:      milliseconds late, 100 to 120 Hz: { {name: round(value, 3) for name, value in late.items()} }; linear to 50 Hz {float(np.median(np.arange(50, 450) / 50 - halves)) * 1000:.3f}")
assert abs(late["sinc_best"]) < 0.01 and abs(late["linear"] - 10) < 0.01 and late["zero_order_hold"] >= 10, "this has changed"
PYTHON
