"""The initial weights of a run's first training, unless they are random."""

from __future__ import annotations

import json
from pathlib import Path

from flywheel.dynamics.gnn import NetworkConfig, load_weights
from flywheel.dynamics.gnn.shipped import SHIPPED, shipped_weights
from flywheel.errors import ConfigError
from flywheel.robots import Robot
from flywheel.runtime.config.run_config import RunConfig

INITIAL_WEIGHTS = "initial.npz"  # the run's own copy
SIDE_FILE = "initial.json"


def initial_weights(config: RunConfig, robot: Robot) -> Path | None:
    """The file that `training.from` names; None for random weights.

    Raises:
      ModelError: there are no such weights, or they are of another robot.
      ConfigError: they are of another network than the run's; the message lists the settings to
        change.
    """
    source = config.training.start_from
    if not source:
        return None
    path = shipped_weights(robot) if source == SHIPPED else Path(source)
    theirs = load_weights(path, robot).config
    if wanted := _overrides(config.network, theirs):
        raise ConfigError(
            f"training.from={source} is another network than the run's. It needs {' '.join(wanted)}."
        )
    return path


def _overrides(own: NetworkConfig, theirs: NetworkConfig) -> list[str]:
    """Command-line settings that turn one network into the other; weights suit any number of surfaces."""
    before, after = own.model_dump(mode="json"), theirs.model_dump(mode="json")
    changed = {k: v for k, v in after.items() if k != "surfaces" and v != before[k]}
    return [f"network.{key}={json.dumps(value)}" for key, value in changed.items()]
