"""Two Ray nodes on this machine, of which one is taken away while jobs run.

    python -m tests.integration.two_nodes

A process of its own, because a process has one Ray.
"""

import sys
import tempfile
import threading

import numpy as np
from ray.cluster_utils import Cluster as Nodes

from flywheel.runtime.pool.jobs import Group, Job
from flywheel.runtime.pool.pool import Patience, WorkerPool
from flywheel.runtime.pool.ray_backend import Cluster, RayBackend
from tests.integration.stunt_workers import Stunt, by_value

FAST = {"health_check_period_ms": 500, "health_check_failure_threshold": 3}


def main() -> int:
    """Do four jobs of two seconds on two nodes; the second node goes after a while."""
    by_value()
    nodes = Nodes(
        initialize_head=True,
        head_node_args={"num_cpus": 1, "_system_config": FAST, "include_dashboard": False},
    )
    other = nodes.add_node(num_cpus=1)
    with (
        Cluster(address=nodes.address) as cluster,
        tempfile.TemporaryDirectory() as at,
    ):
        groups = [Group("stunt", Stunt, (at,), count=2)]
        cluster.check_fits(groups)
        pool = WorkerPool(RayBackend(), groups, 2, Patience(start=60, stall=20))
        jobs = [Job(f"draw-{i}", "stunt", "draw", (i, 2.0)) for i in range(4)]
        done: list[str] = []

        def on_result(job: Job, result: object) -> None:
            done.append(job.id)
            if len(done) == 1:
                remove = nodes.remove_node
                threading.Thread(
                    target=remove, args=(other,), kwargs={"allow_graceful": False}
                ).start()

        report = pool.run(jobs, on_result)
        pool.close()
    expected = [float(np.random.default_rng(i).normal()) for i in range(4)]
    same = [report.results[job.id][0] for job in jobs] == expected
    sys.stdout.write(f"same={same} restarts={report.restarts} quarantined={report.quarantined}\n")
    nodes.shutdown()
    return 0 if same and report.restarts >= 1 else 1


if __name__ == "__main__":
    sys.exit(main())
