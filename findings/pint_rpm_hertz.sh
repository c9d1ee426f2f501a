#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pint==0.25.3
echo "guess:     60 rpm are 1 Hz"
echo "behaviour: a turn is the number 2 pi, and a hertz is 1/s: 60 rpm are 6.28 Hz, and a motor of 50 Hz turns at 477 rpm"
python - <<'PYTHON'
from pint import UnitRegistry

units = UnitRegistry()
speed = units.Quantity(60, "rpm").to("Hz").magnitude
motor = units.Quantity(50, "Hz").to("rpm").magnitude
print(f"seen:      60 rpm are {speed:.4f} Hz, 50 Hz are {motor:.1f} rpm")
assert abs(speed - 6.2832) < 1e-4 and abs(motor - 477.5) < 0.1, "this has changed"
PYTHON
