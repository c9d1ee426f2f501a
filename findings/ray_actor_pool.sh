#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" ray==2.60.0
echo "guess:     ActorPool does an item again, or says which one it was, when the actor at work on it dies"
echo "behaviour: the item is dropped; an ActorDiedError without it comes once, and the others are done"
export RAY_AUTH_MODE=disabled RAY_USAGE_STATS_ENABLED=0
python - 2> ray.log <<'PYTHON' | grep ^seen # Ray prints, too
import os

import ray
from ray.util import ActorPool

ray.init(address="local", num_cpus=2, include_dashboard=False, logging_level="ERROR")


@ray.remote
class Squarer:
    def square(self, x):
        if x == 3:
            os._exit(1)  # as where the system ends a process for its memory
        return x * x


pool = ActorPool([Squarer.remote(), Squarer.remote()])
for x in range(6):
    pool.submit(lambda actor, value: actor.square.remote(value), x)
done, errors = [], []
while pool.has_next():
    try:
        done.append(pool.get_next_unordered(timeout=60))
    except ray.exceptions.RayError as error:
        errors.append(type(error).__name__)

print(f"seen:      results {sorted(done)} of six items, errors {errors}")
assert sorted(done) == [0, 1, 4, 16, 25] and errors == ["ActorDiedError"], "this has changed"
PYTHON
