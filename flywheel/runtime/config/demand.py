"""The memory and disk space that a configuration needs, checked before anything starts.

The bounds of single settings are in `flywheel.quantities`; here the products of several are bounded. They
are estimates in bytes, right to a factor of about three on the shipped robots. A configuration that is
refused would fill the memory or the disk long before its end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flywheel.errors import ConfigError

if TYPE_CHECKING:
    from flywheel.runtime.config.run_config import RunConfig

GB = 1e9  # [bytes]
MEMORY = 16 * GB  # that one process may use for one purpose
DISK = 1000 * GB  # that a run may fill
MOST_EPISODES = 100_000  # of a run; each has its own files, and every stage lists all of them
# These were measured on prism3 and icosa6.
PREDICTED = 2e3  # for each step of a prediction [bytes]
EPISODE = 2e3  # for each step of an episode [bytes]
WEIGHTS = (
    160  # for a layer, per width x width: ten numbers, their gradients and two moments [bytes]
)
GRADIENT = (
    1.5e3  # for a prediction chunk in a layer, per width, until its gradient is computed [bytes]
)
STARTS = 256  # short predictions that `evaluation.score` makes at a time
WHOLE = 64  # predictions of whole episodes that `evaluation.score_full` makes at a time


@dataclass(frozen=True)
class Demand:
    """The memory or disk space that one purpose needs.

    Attributes:
      what: name of the purpose in the plural, with the settings that decide it.
      bytes: that are needed.
      most: bytes that are allowed.
    """

    what: str
    bytes: float
    most: float = MEMORY

    def __str__(self) -> str:
        return (
            f"{self.what} take about {self.bytes / GB:,.0f} GB; at most {self.most / GB:,.0f} GB are "
            "allowed"
        )


def check_predictions(number: int, seconds: float, dt: float, options: str) -> None:
    """Refuse more predictions at a time than fit into the memory.

    Args:
      number: of predictions.
      seconds: length of each [s].
      dt: control step [s].
      options: of the command that decide this, e.g. "--draws, --horizon and --dt".

    Raises:
      ConfigError: they do not fit.
    """
    what = f"{number:,} predictions of {seconds:g} s in control steps of {dt:g} s ({options})"
    demand = Demand(what, PREDICTED * number * seconds / dt)
    if demand.bytes > demand.most:
        raise ConfigError(f"{demand}.")


def problems(config: RunConfig) -> list[str]:
    """Why no machine could do the run, as sentences; empty if one could."""
    too_large = [str(demand) for demand in _demands(config) if demand.bytes > demand.most]
    return [*_too_short(config), *_too_many(config), *too_large]


def _episodes(config: RunConfig) -> dict[str, tuple[int, float]]:
    """For each setting of a duration: how many such episodes the whole run has, and their length [s]."""
    collect, evaluate = config.collect, config.evaluate
    trained = config.iterations * (1 + config.control_arm)
    driven = 1 + trained + evaluate.oracle + (1 + evaluate.oracle) * len(evaluate.unseen)
    kinds = {
        "collect.gait_seconds": (collect.gaits, collect.gait_seconds),
        "collect.random_seconds": (collect.random, collect.random_seconds),
        "collect.drop_seconds": (collect.drops, collect.drop_seconds),
        "collect.mppi_seconds": (trained * collect.mppi, collect.mppi_seconds),
        "task.seconds": (driven * evaluate.tasks, config.task.seconds),
    }
    return {name: kind for name, kind in kinds.items() if kind[0]}


def _too_short(config: RunConfig) -> Iterator[str]:
    dt = config.network.dt
    times = {
        **{name: seconds for name, (_, seconds) in _episodes(config).items()},
        "evaluate.horizon_seconds": config.evaluate.horizon_seconds,
        "training.validation_seconds": config.training.validation_seconds,
    }
    for name, seconds in times.items():
        if round(seconds / dt) < 1:
            yield f"{name} ({seconds:g} s) is shorter than a control step, network.dt ({dt:g} s)"


def _too_many(config: RunConfig) -> Iterator[str]:
    episodes = sum(count for count, _ in _episodes(config).values())
    if episodes > MOST_EPISODES:
        yield (
            f"the run has {episodes:,} episodes (collect, iterations, evaluate.tasks); at most "
            f"{MOST_EPISODES:,} are allowed"
        )


def _demands(config: RunConfig) -> Iterator[Demand]:
    recorded, dt = _episodes(config), config.network.dt
    network, training, evaluate = config.network, config.training, config.evaluate
    step = f"in control steps of {dt:g} s (network.dt)"
    for name, (count, seconds) in recorded.items():
        about = f"of {seconds:g} s ({name}) {step}"
        yield Demand(f"episodes {about}", EPISODE * seconds / dt)
        if evaluate.full:
            whole = PREDICTED * min(WHOLE, count) * seconds / dt
            yield Demand(f"predictions (evaluate.full) of whole episodes {about}", whole)
    everything = sum(count * seconds for count, seconds in recorded.values())
    about = f"{everything:,.0f} s of episodes (collect, iterations, evaluate.tasks) {step}"
    yield Demand(f"all {about}", EPISODE * everything / dt, DISK)

    samples = max(config.mppi.samples, config.collect.mppi_samples or 0)
    for name, number, seconds in (
        (f"{samples:,} plans (mppi.samples)", samples, config.mppi.horizon_seconds),
        ("predictions (evaluate.horizon_seconds)", STARTS, evaluate.horizon_seconds),
        (
            f"{training.validation_windows:,} predictions (training.validation_windows)",
            training.validation_windows,
            training.validation_seconds,
        ),
    ):
        yield Demand(f"{name} of {seconds:g} s {step}", PREDICTED * number * seconds / dt)

    layers = network.rounds * network.mlp_layers
    shape = f"a network of {network.rounds} rounds (network.rounds) of {network.mlp_layers} layers "
    shape += f"(network.mlp_layers) of width {network.width:,} (network.width)"
    yield Demand(f"the weights of {shape}", WEIGHTS * layers * network.width**2)
    stages = (*training.initial.stages, *training.fine_tuning.stages)
    chunks = max(
        training.chunks_per_batch, training.least_windows * max(stage.chunks for stage in stages)
    )
    batch = f"{chunks:,} chunks (training.chunks_per_batch, or least_windows of a stage's chunks)"
    yield Demand(f"batches of {batch} in {shape}", GRADIENT * chunks * layers * network.width)
