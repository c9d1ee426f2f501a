#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" psutil==7.2.2
echo "guess:     when Popen has returned, the program runs, and environ() of its process is its environment"
echo "behaviour: for some it is empty: Linux closes the pipe that Popen waits for before it has laid out the program"
python - <<'PYTHON'
import subprocess

import psutil

TRIALS = 3000
empty, later = 0, 0
for _ in range(TRIALS):
    with subprocess.Popen(["sleep", "60"], env={"MARK": "yes", "PATH": "/usr/bin:/bin"}) as program:
        process = psutil.Process(program.pid)
        if process.environ() == {}:
            empty += 1
            while not process.environ():
                pass
            later += process.environ()["MARK"] == "yes"
        program.kill()
print(f"seen:      {empty} of {TRIALS} were empty; {later} of these had the environment a moment later")
assert empty > 0 and later == empty, "this has changed"
PYTHON
