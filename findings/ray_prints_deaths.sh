#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" ray==2.60.0
echo "guess:     with log_to_driver=False and logging_level=ERROR a driver's standard output is its own"
echo "behaviour: Ray prints a paragraph there about each worker that dies, in between what the driver prints"
export RAY_AUTH_MODE=disabled RAY_USAGE_STATS_ENABLED=0
python - > out.txt 2> ray.log <<'PYTHON'
import os
import time

import ray

ray.init(
    address="local", num_cpus=1, include_dashboard=False, log_to_driver=False, logging_level="ERROR"
)


@ray.remote
class Worker:
    def end(self):
        os._exit(1)


try:
    ray.get(Worker.remote().end.remote())
except ray.exceptions.RayError:
    print('{"died": 1}')
time.sleep(3)
PYTHON
lines="$(grep -c "A worker died" out.txt || true)"
echo "seen:      $(grep -c . out.txt) lines on standard output, $lines of them Ray's: $(grep -o "A worker died[^.]*" out.txt | head -1)"
[[ "$lines" -ge 1 ]] || { echo "this has changed"; exit 1; }
