#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" obspy==1.5.1 numpy==2.4.6 scipy==1.17.1 setuptools==80.9.0
echo "guess:     Trace.resample from 100 to 200 Hz leaves a vibration below 50 Hz as large as it was"
echo "behaviour: it fades all frequencies on their way to 50 Hz, also upwards and at an unchanged rate: of 20 Hz two thirds are left; window=None does not"
python -W ignore - <<'PYTHON'
import numpy as np
from obspy import Trace

times = np.arange(1000) / 100


def amplitude(frequency, rate, **options):
    """That of a sine of 1 m/s2 in the middle of ten seconds, after it was resampled from 100 Hz to this rate [Hz]."""
    trace = Trace(np.sin(2 * np.pi * frequency * times), {"sampling_rate": 100.0}).resample(rate, **options)
    quarter = len(trace.data) // 4
    return round(float(np.sqrt(2) * trace.data[quarter:-quarter].std()), 3)


frequencies = (1, 5, 10, 20, 30, 40)
seen = {rate: [amplitude(frequency, rate) for frequency in frequencies] for rate in (200.0, 100.0)}
plain = [amplitude(frequency, 200.0, window=None) for frequency in frequencies]
print(f"seen:      amplitudes of {frequencies} Hz by the new rate: {seen}; with window=None at 200 Hz {plain}")
for amplitudes in seen.values():
    expected = (1 + np.cos(np.pi * np.array(frequencies) / 50)) / 2
    assert np.abs(np.array(amplitudes) - expected).max() < 1e-3, "this has changed"
assert min(plain) > 0.999, "this has changed"
PYTHON
