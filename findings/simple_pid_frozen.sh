#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" simple-pid==2.0.1
echo "guess:     a controller that is called every 5 ms, with dt=0.005, computes an output at each call, or at every second one"
echo "behaviour: never again after the first: each dt is compared with sample_time, 0.01, by itself; with 10 ms it works"
python - <<'PYTHON'
from simple_pid import PID


def outputs(dt, **options):
    """The outputs of the first 0.1 s of a load that starts at 0, is to go to 1, and moves with the output as its velocity."""
    controller, position, found = PID(2.0, setpoint=1.0, **options), 0.0, []
    for _ in range(round(0.1 / dt)):
        found.append(controller(position, dt=dt))
        position += dt * found[-1]
    return [round(output, 3) for output in found]


slow, fast, always = outputs(0.01), outputs(0.005), outputs(0.005, sample_time=None)
print(f"seen:      every 10 ms {slow}")
print(f"           every 5 ms {fast}; with sample_time=None {always}")
assert set(fast) == {2.0} and len(set(slow)) == 10 and len(set(always)) == 20, "this has changed"
PYTHON
