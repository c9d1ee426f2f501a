"""A plant with permanent effects: the MJCF and the physics missing from it."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from flywheel.dynamics.plant.augmented import AugmentedPlant, Memories, Motion, edited
from flywheel.dynamics.plant.channels import ChannelKey
from flywheel.dynamics.plant.parameters import PlantParameters
from flywheel.dynamics.plant.plant import Course, Plant
from flywheel.effects import ModelEffect, Terms, points_late
from flywheel.errors import ModelError
from flywheel.records import Floats, Observation, State, Trajectory
from flywheel.terrain import Terrain


class EffectivePlant(Plant):
    """`Plant` with the same effects in every simulation.

    `simulate` starts with fresh cables and with winches without previous commands: delays, play and
    memories of cables start anew. `begin` keeps them from piece to piece of an episode.

    Args:
      plant: without effects, and with one set of parameters for all simulations.
      terms: the effects with their values.

    Raises:
      ModelError: parameters differ between simulations.
    """

    def __init__(self, plant: Plant, terms: Terms) -> None:
        if not isinstance(plant.parameters, PlantParameters):
            raise ModelError("A plant with effects has one set of parameters for all simulations.")
        self.terms = terms
        super().__init__(plant.robot, *plant.arguments())
        self._augmented = AugmentedPlant(plant)

    def __reduce__(self) -> tuple[Any, ...]:
        return (EffectivePlant, (self._augmented.plant, self.terms))

    def on(self, terrain: Terrain | None) -> EffectivePlant:
        """The same plant on another ground; itself if that is its own."""
        if terrain == self.terrain:
            return self
        return EffectivePlant(self._augmented.plant.on(terrain), self.terms)

    @cached_property
    def _measured(self) -> AugmentedPlant:
        """The same that tells winches apart which are measured at other times than points."""
        winches = self.robot.winches if points_late(self.terms) else ()
        keys: list[ChannelKey] = [("winch", winch.name) for winch in winches]
        return AugmentedPlant(self._augmented.plant, keys) if keys else self._augmented

    def _compile(self) -> None:
        super()._compile()
        # `observe` uses this model only: for markers that moved, whatever the masses are.
        seen = tuple(
            t for t in self.terms if isinstance(t.effect, ModelEffect) and not t.effect.moves_mass
        )
        self._models = [edited(self._models[0], self.robot, seen)]

    def simulate(self, state: State, controls: Floats) -> Trajectory:
        """Simulate each state under its controls, as `Plant.simulate` does."""
        controls = np.asarray(controls, float)
        batch, _ = self._check(state, controls)
        many = state[np.zeros(batch, int)] if len(state.qpos) == 1 else state
        told = self._augmented.commands(controls, [self.terms] * batch)
        return self._trajectory(self._moved(many, told, None), controls)

    def begin(self, state: State) -> Course:
        """Start an episode from a state (1,), as `Plant.begin` does."""
        return _EffectiveCourse(self, state)

    def _moved(
        self, state: State, told: Floats, memory: Memories | None, steps: int | None = None
    ) -> Motion:
        how = self._augmented if steps is None else self._measured
        motion = how.simulate(state, told, [self.terms] * len(told), memory, steps)
        if not motion.finite.all():
            raise ModelError(
                f"Simulation {int(np.argmin(motion.finite))} of {len(told)} of {self.robot.name} with "
                f"{', '.join(t.label(self.robot) for t in self.terms)} diverged: MuJoCo found no finite "
                "acceleration. Smaller effects, or a smaller timestep in the MJCF, help."
            )
        return motion

    def _trajectory(self, motion: Motion, controls: Floats) -> Trajectory:
        seen = Observation(motion.points, self.winch(motion.states))
        within = np.clip(controls, self.robot.control_low, self.robot.control_high)
        return Trajectory(seen, within, self.dt, motion.states)


def with_effects(plant: Plant, terms: Terms) -> Plant:
    """The plant with additional effects; itself without any.

    Raises:
      ModelError: see `EffectivePlant`.
    """
    if not terms:
        return plant
    plain = Plant(plant.robot, *plant.arguments())
    return EffectivePlant(plain, (*plant.terms, *terms))


class _EffectiveCourse(Course):
    """The commands so far, and the memory of the cables. Winches are not measured as late as points."""

    def __init__(self, plant: EffectivePlant, state: State) -> None:
        super().__init__(plant, state)
        self._effective = plant
        self._controls = np.empty((1, 0, len(plant.robot.winches)))
        self._memory: Memories | None = None

    def go(self, controls: Floats) -> Trajectory:
        plant, done = self._effective, self._controls.shape[1]
        controls = np.asarray(controls, float)
        plant._check(self.state, controls)
        self._controls = np.concatenate([self._controls, controls], axis=1)
        told = plant._measured.commands(self._controls, [plant.terms])[:, done:]
        motion = plant._moved(self.state, told, self._memory, controls.shape[1])
        self.state, self._memory = motion.states[:, -1], motion.memory
        made = plant._trajectory(motion, controls)
        if not motion.channels.size:
            return made
        return replace(made, observations=replace(made.observations, winch=motion.channels))
