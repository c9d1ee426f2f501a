"""The smallest run there can be, with workers in this process: the loop without a cluster."""

from flywheel.data import TrajectoryStore
from flywheel.runtime.config.run_config import RunConfig, continued
from flywheel.runtime.loop import finish
from flywheel.runtime.pool.jobs import Group
from flywheel.runtime.pool.pool import WorkerPool
from flywheel.runtime.pool.progress import Lines
from flywheel.runtime.run.context import Run
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.workers.robot_worker import RobotWorker
from flywheel.runtime.workers.sim_worker import SimWorker
from flywheel.runtime.workers.trainer_worker import TrainerWorker
from tests.unit.runtime.local_backend import LocalBackend

TINY = {
    "name": "tiny",
    "iterations": 1,
    "control_arm": False,
    "collect": {
        "gaits": 0,
        "random": 5,
        "random_seconds": 1.2,
        "drops": 0,
        "mppi": 2,
        "mppi_seconds": 1.0,
    },
    "task": {"seconds": 1.0, "radius": [0.4, 0.6]},
    "mppi": {"samples": 4, "horizon_seconds": 0.5, "elites": 1},
    "network": {"width": 8, "rounds": 1, "warmup_chunks": 1},
    "training": {
        "initial": {
            "steps": 4,
            "stages": [{"chunks": 1, "share": 1}],
            "learning_rate": 1e-3,
            "warmup_steps": 1,
        },
        "fine_tuning": {
            "steps": 2,
            "stages": [{"chunks": 1, "share": 1}],
            "learning_rate": 1e-5,  # weights change, and are not so bad that the first ones are kept
            "warmup_steps": 1,
        },
        "chunks_per_batch": 8,
        "least_windows": 32,
        "validate_every": 2,
        "validation_windows": 4,
        "validation_seconds": 0.3,
    },
    "evaluate": {"tasks": 1, "horizon_seconds": 0.5, "starts": 2, "full": False, "video": False},
    "workers": {"least_free_gb": 0},
}


class Bench:
    """Runs in one folder, with everything that can be looked at afterwards."""

    def __init__(self, folder, **changes) -> None:
        self.config = RunConfig.model_validate({**TINY, **changes})
        self.files = RunFolder(folder)
        self.store = TrajectoryStore(self.files.store_url(self.config))
        self.said: list[str] = []

    def turn(self, resume: bool = False):
        self.backend = LocalBackend()
        identity = self.files.begin(self.config, resume)
        # As in a run, where nobody but the robot's workers knows all of it.
        config = continued(self.files.config(), self.config)
        robot = self.files.robot(config)
        arguments = (config, self.files.store_url(config), robot)
        groups = [Group("sim", SimWorker, arguments), Group("trainer", TrainerWorker, arguments)]
        if config.robot is not None:
            groups.append(Group("robot", RobotWorker, (*arguments, self.files.robot_folder)))
        pool = WorkerPool(self.backend, groups, cores=2)
        progress = Lines(self.said.append)
        run = Run(config, self.files, robot, self.store, pool, None, progress)
        try:
            return finish(run, identity)
        finally:
            pool.close()
            for worker in self.backend.workers:
                if isinstance(worker, RobotWorker):
                    worker.close()

    def digests(self) -> dict[str, str]:
        """Of everything a finished run consists of."""
        self.files.path.mkdir()
        result = self.turn()
        return {i.model: i.snapshot for i in result.iterations} | {
            "walks": result.iterations[0].navigation.model_dump_json(exclude={"plan_seconds"})
        }
