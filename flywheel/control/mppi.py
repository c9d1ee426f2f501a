"""Model predictive path integral control: sample plans, roll them out, average the good ones.

K plans are drawn around the current one; plan k costs C_k and weighs exp(-(C_k - min C) / beta);
the weighted mean is the new plan, whose beginning is executed (paper, section 3.3).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from flywheel.control.gaits import refuse_other_robots, turning
from flywheel.control.knots import Knots
from flywheel.control.mppi_config import MppiConfig
from flywheel.control.protocol import Command
from flywheel.dynamics.protocol import Dynamics
from flywheel.errors import ConfigError, ModelError
from flywheel.records import Floats, Past, Rollout
from flywheel.tasks import Task

SHOWN = 12  # candidates per plan that a video shows


class Mppi:
    """Plans with any dynamics model.

    Args:
      dynamics: the model.
      config: see `MppiConfig`.
      name: for provenance.
      model: digest of the model's weights, or "".

    Raises:
      ConfigError: the model's dt does not divide the configured times, or the robot has no gaits.
    """

    def __init__(
        self, dynamics: Dynamics, config: MppiConfig, name: str = "mppi", model: str = ""
    ) -> None:
        self.dynamics, self.config, self.name, self.model = dynamics, config, name, model
        if config.turning:
            refuse_other_robots(dynamics.robot)
        steps = config.steps(dynamics.dt)
        self._act_steps = steps["replan_seconds"]
        count = -(-steps["horizon_seconds"] // steps["knot_seconds"])
        self.knots = Knots(dynamics.robot, dynamics.dt, steps["knot_seconds"], count)
        self._horizon = steps["horizon_seconds"]
        self.reset(None, 0)

    @property
    def history(self) -> int:
        """Past control steps used by the model."""
        return self.dynamics.history

    def reset(self, task: Task | None, seed: int) -> None:
        """Start an episode without a plan."""
        self._task, self._rng = task, np.random.default_rng(seed)
        self._plan: Floats | None = None
        self._elites: Floats | None = None

    def act(self, past: Past) -> Command:
        """Plan from the present, and return the plan's beginning.

        Raises:
          ConfigError: there is no task.
          ModelError: no rollout was finite.
        """
        if self._task is None:
            raise ConfigError("MPPI needs a task; call reset with one first.")
        begun = time.perf_counter()
        winch, config = self._winch_at_begin(past), self.config
        plan = self._resumed(winch)
        for turn in range(config.rounds):
            noise = config.noise * config.narrowing**turn
            candidates = self._candidates(plan, noise)
            search = self._try(past, winch, candidates)
            plan = np.einsum("k,ksw->sw", search.weights, candidates)
            best = np.argsort(search.costs, kind="stable")[: config.elites]
            self._elites = candidates[best]
        self._plan = plan
        controls, now = self.knots.controls(winch, plan), self._act_steps
        seconds = time.perf_counter() - begun
        seen = search.diagnostics() | {"paths": self._paths(search)}
        return Command(controls[:now], seconds, seen, tail=controls[now:])

    def _winch_at_begin(self, past: Past) -> Floats:
        """(W,) winch positions at the beginning of the plan [m]."""
        if past.pending is None or not past.pending.shape[1]:
            return past.winch[0, -1]
        dynamics = self.dynamics
        return dynamics.robot.wind(past.winch[0, -1], past.pending[0], dynamics.dt)[-1]

    def _paths(self, search: TriedPlans) -> Floats:
        """(SHOWN, M, 2) paths of candidates, best first, one point per knot [m]."""
        assert self._task is not None
        order = np.argsort(search.costs, kind="stable")[: np.isfinite(search.costs).sum()]
        shown = order[np.linspace(0, len(order) - 1, SHOWN).round().astype(int)]
        every = self.knots.steps
        return self._task.place(search.rollout.points[shown][:, ::every])

    def _resumed(self, winch: Floats) -> Floats:
        """The rest of the last plan, or a holding plan."""
        if self._plan is None:
            return np.repeat(winch[None], self.knots.count, axis=0)
        if self._elites is not None:
            self._elites = self.knots.later(self._elites, self._act_steps)
        return self.knots.later(self._plan, self._act_steps)

    def _candidates(self, plan: Floats, noise: float) -> Floats:
        """(K, S, W): the plan itself, the best earlier ones, fresh ones and noisy ones."""
        robot, config = self.dynamics.robot, self.config
        low, range_ = robot.rest_low, robot.rest_high - robot.rest_low
        kept = plan[None] if self._elites is None else np.concatenate([plan[None], self._elites])
        kept = kept[: max(1, config.samples // 2)]
        left = config.samples - len(kept)
        fresh, turns = round(config.fresh * left), round(config.turning * left)
        turns = min(turns, left - fresh)  # both may be rounded up
        noisy = smooth_noise((left - fresh - turns, *plan.shape), config.smoothness, self._rng)
        hold = max(1, round(config.fresh_seconds / config.knot_seconds))
        steps = strokes((fresh, *plan.shape), hold, self._rng)
        parts = [kept, low + range_ * steps, plan + noise * range_ * noisy]
        if turns:
            parts.append(turning(robot, (turns, *plan.shape), hold, self._rng))
        drawn = np.concatenate(parts)
        return np.clip(drawn, robot.rest_low, robot.rest_high)

    def _rollout(self, past: Past, controls: Floats) -> Rollout:
        """Rollouts from the beginning of the plan, preceded by pending commands."""
        if past.pending is None or not past.pending.shape[1]:
            return self.dynamics.rollout(past, controls)
        first = np.repeat(past.pending, len(controls), axis=0)
        whole = self.dynamics.rollout(past, np.concatenate([first, controls], axis=1))
        begin = first.shape[1]
        return Rollout(whole.points[:, begin:], whole.winch[:, begin:])

    def _try(self, past: Past, winch: Floats, candidates: Floats) -> TriedPlans:
        assert self._task is not None
        controls = self.knots.controls(winch, candidates)[:, : self._horizon]
        rollout = self._rollout(past, controls)
        finite = np.isfinite(rollout.points).all(axis=(1, 2, 3))
        if not finite.any():
            raise ModelError(f"None of {len(candidates)} rollouts of {self.name} is finite.")
        costs = np.full(len(candidates), np.inf)
        costs[finite] = self._task.cost(rollout.points[finite])
        costs[np.isnan(costs)] = np.inf
        weights = softmin(costs, self.config.temperature, self.config.relative_temperature)
        return TriedPlans(costs, weights, rollout)


@dataclass(frozen=True)
class TriedPlans:
    """Evaluated candidates: costs (K,), weights (K,), and predicted paths."""

    costs: Floats
    weights: Floats
    rollout: Rollout

    def diagnostics(self) -> dict[str, Floats]:
        """Costs, effective number of samples, and the points (H + 1, P, 3) of the best sample."""
        finite = self.costs[np.isfinite(self.costs)]
        return {
            "best_cost": finite.min(),
            "mean_cost": finite.mean(),
            "effective_samples": 1.0 / (self.weights**2).sum(),
            "points": self.rollout.points[self.costs.argmin()],
        }


def softmin(costs: Floats, temperature: float, relative: bool = False) -> Floats:
    """Weights (K,) proportional to exp(-(costs - min) / beta), of sum 1.

    Args:
      costs: (K,); an infinite cost has weight 0.
      temperature: beta > 0.
      relative: count the temperature in standard deviations of the finite costs.

    Raises:
      ModelError: no cost is finite.
    """
    finite = costs[np.isfinite(costs)]
    if not len(finite):
        raise ModelError(f"None of {len(costs)} costs is finite.")
    spread = finite.std() if relative else 1.0
    beta = max(temperature * spread, np.finfo(float).tiny)
    with np.errstate(over="ignore", under="ignore"):
        weights = np.exp(-(costs - finite.min()) / beta)
    return weights / weights.sum()


def smooth_noise(shape: tuple[int, ...], smoothness: float, rng: np.random.Generator) -> Floats:
    """Normal noise (K, S, W) of unit variance, with correlation `smoothness` from knot to knot."""
    noise = rng.standard_normal(shape)
    for knot in range(1, shape[1]):
        fresh = np.sqrt(1.0 - smoothness**2) * noise[:, knot]
        noise[:, knot] = smoothness * noise[:, knot - 1] + fresh
    return noise


def strokes(shape: tuple[int, ...], hold: int, rng: np.random.Generator) -> Floats:
    """Plans (K, S, W) that pull each winch to 0, 1/2 or 1, stay for `hold` knots, and pull again.

    Long full strokes tip a robot over far more often than any small noise does.
    """
    count, knots, winches = shape
    levels = rng.integers(0, 3, (count, 1 + -(-knots // hold), winches)) / 2
    offset = rng.integers(0, hold, count)  # the first stroke may be a shorter one
    number = (np.arange(knots) + offset[:, None]) // hold
    return levels[np.arange(count)[:, None], number]
