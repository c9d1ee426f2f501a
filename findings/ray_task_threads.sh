#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" ray==2.60.0 threadpoolctl==3.6.0 numpy==2.4.6
echo "guess:     a Ray task computes with as many threads as its num_cpus; Ray sets OMP_NUM_THREADS to that"
echo "behaviour: a worker that is used again keeps the threads of its first task, and shows the new OMP_NUM_THREADS"
export RAY_AUTH_MODE=disabled RAY_USAGE_STATS_ENABLED=0
unset OMP_NUM_THREADS OPENBLAS_NUM_THREADS
python - 2> ray.log <<'PYTHON' | grep ^seen # Ray prints, too
import os

import ray

ray.init(address="local", num_cpus=2, include_dashboard=False, logging_level="ERROR")


@ray.remote
def threads():
    import numpy  # noqa: F401
    from threadpoolctl import threadpool_info

    (pool,) = threadpool_info()
    return os.getpid(), os.environ["OMP_NUM_THREADS"], pool["num_threads"]


found = [ray.get(threads.options(num_cpus=n).remote()) for n in (1, 2, 1)]
same = len({pid for pid, *_ in found}) == 1
print(f"seen:      num_cpus 1, 2, 1 in one worker ({same}): OMP_NUM_THREADS and threads of numpy {[each[1:] for each in found]}")
assert same and [each[1:] for each in found] == [("1", 1), ("2", 1), ("1", 1)], "this has changed"
PYTHON
