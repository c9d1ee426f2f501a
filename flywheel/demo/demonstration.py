"""A robot that differs from its model: recorded, compared, diagnosed, adopted, compared again, and
revealed.

The robot is a stand-in in its own process. Its hidden effect is known to that process, and here
used in the last line only: everything between receives measurements and commands alone.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from flywheel import __version__
from flywheel.control import EpisodeOrder, Playback
from flywheel.control.drive import drive
from flywheel.demo.assessment import Assessment, assess, library_values, smallest_shown
from flywheel.diagnosis import Diagnosis, diagnose
from flywheel.diagnosis.adoption import adoptable
from flywheel.diagnosis.comparison import Comparison, Outcome, Subject, compare
from flywheel.dynamics.plant import Plant, Reckoning, with_effects
from flywheel.effects import EFFECTS, NAMED, Effect, WrittenTerm
from flywheel.errors import DataError, LinkError
from flywheel.options import ComparisonOptions
from flywheel.quantities import Bounds, ControlStep, DemoSeconds, HorizonSeconds, Samples, Threads
from flywheel.records import Episode, Provenance, Split, Trajectory
from flywheel.reports.comparison_page import sentence
from flywheel.reports.diagnosis_page import sentence as diagnosed_words
from flywheel.robot_link import RobotLink, StandInConfig
from flywheel.robot_link.opening import SIMULATED, open_link
from flywheel.robots import Robot
from flywheel.runtime.pool.progress import Progress, Stage
from flywheel.truth_simulator import HIDDEN, EffectTruth, HiddenEffect
from flywheel.truth_simulator.scripts import script
from flywheel.truth_simulator.written import PLACE, SIZE, hidden_effects
from flywheel.validation import Frozen

NOTHING = "none"  # in the place of an effect
DRAWN = 2.0  # size of what is drawn, in typical ones: noise in the starts of predictions hides most of less
GIVEN, ADOPTED = "the MJCF as given", "the MJCF with the identified effects"
# Every winch by itself, and big strokes that load the motors; then all winches tight.
SCRIPTS: tuple[tuple[str, Split], ...] = (
    ("random_steps", "train"),
    ("gait", "train"),
    ("pretension", "test"),
    ("random_steps", "test"),
)
PLACES = ("end cap", "cable")  # criteria of a comparison that are named in a sentence
HELD_OUT: Split = "test"
SEEDS = 2**31  # of single recordings
# Beside a recording's seed: its commands have a stream of their own, apart from the noise.
COMMANDS = 1


class DemoConfig(Frozen):
    """Size of a demonstration.

    Attributes:
      seconds: of each recording [s].
      held_out: recordings for the evaluation of answer and models.
      horizon: of the compared predictions [s].
      draws: of the noise, for its influence on errors.
      dt: control step [s].
      threads: simulations at the same time.
    """

    seconds: DemoSeconds = 3.0
    held_out: Annotated[int, Bounds(1, 2)] = 2
    horizon: HorizonSeconds = 1.0
    draws: Samples = 100
    dt: ControlStep = 0.01
    threads: Threads = 2

    @property
    def scripts(self) -> tuple[tuple[str, Split], ...]:
        """Name of each command script, and the purpose of its recording."""
        return SCRIPTS[: 2 + self.held_out]


@dataclass(frozen=True)
class Demonstration:
    """The whole story.

    Attributes:
      robot: of the MJCF.
      seed: of all random draws.
      config: its size.
      recordings: measurements of the robot; those of the split "test" are held out.
      before: comparison of the unchanged MJCF with the held-out recordings.
      diagnosis: of the others.
      adopted: effects added to the plant; empty if not justified.
      why: reason for the adoption, or against it.
      after: comparison of that plant with the same recordings; None without adoption.
      hidden: the robot's effect beyond its MJCF; None for nothing.
      assessment: of the diagnosis.
      seconds: duration.
    """

    robot: Robot
    seed: int
    config: DemoConfig
    recordings: tuple[Episode, ...]
    before: Comparison
    diagnosis: Diagnosis
    adopted: tuple[WrittenTerm, ...]
    why: str
    after: Comparison | None
    hidden: EffectTruth | None
    assessment: Assessment
    seconds: float

    @property
    def beside(self) -> Comparison:
        """Both models against the held-out recordings, the unchanged one first."""
        if self.after is None:
            return self.before
        return dataclasses.replace(
            self.before,
            models=(*self.before.models, *self.after.models),
            seconds=self.before.seconds + self.after.seconds,
        )


def drawn_effect(robot: Robot, seed: int) -> str:
    """A possible effect of the robot, with its place and its size, in the format of `hidden_effects`."""
    rng = np.random.default_rng(seed)
    able = [kind for kind in HIDDEN.values() if kind.applies(robot)]
    return placed_effect(robot, able[int(rng.integers(len(able)))], rng)


def placed_effect(robot: Robot, kind: type[HiddenEffect], rng: np.random.Generator) -> str:
    """An effect of a kind, at a random place if it has one."""
    truth = kind.typical(robot, rng).truth(robot)
    place = f"{PLACE}{truth.place}" if truth.place else ""
    return f"{truth.name}{place}{SIZE}{DRAWN:g}"


def hidden_truth(effect: str, robot: Robot) -> EffectTruth | None:
    """An effect in numbers; None for "none".

    Args:
      effect: NAME[@PLACE][:SIZE], or "none".
      robot: that has it.

    Raises:
      UnknownNameError, ConfigError: see `hidden_effects`.
    """
    effects = hidden_effects(() if effect == NOTHING else (effect,), robot)
    return effects[0].truth(robot) if effects else None


def demonstrate(
    robot: Robot,
    effect: str,
    seed: int,
    config: DemoConfig,
    progress: Progress,
    library: Mapping[str, Effect] = EFFECTS,
) -> Demonstration:
    """Hide an effect in a stand-in, and try to identify it.

    Args:
      robot: of the MJCF.
      effect: hidden one: NAME[@PLACE][:SIZE], or "none".
      seed: of commands, noise and all other random numbers.
      config: size of the demonstration.
      progress: receives each step, and each finding in a sentence.
      library: candidate effects.

    Raises:
      UnknownNameError, ConfigError: there is no such effect, or it cannot be hidden in this robot.
      LinkError: the stand-in does not start, or is lost.
      DataError, ModelError: recordings are too short, or a simulation diverges.
    """
    begun = time.perf_counter()
    hidden = hidden_truth(effect, robot)
    recordings = _recorded(robot, effect, seed, config, progress)
    fit = [each.trajectory for each in recordings if each.split != HELD_OUT]
    held_out = {
        f"held-out recording {number}": each.trajectory
        for number, each in enumerate(recordings)
        if each.split == HELD_OUT
    }
    plant = Plant(robot, config.dt, threads=config.threads)
    before = _compared(Subject.of_plant(GIVEN, plant), held_out, seed, config, progress)
    with progress.stage("diagnose", 1.0) as stage:
        others = list(held_out.values())
        found = diagnose(plant, fit, others, library, progress=stage.update)
    progress.say(f"{found.verdict}: {diagnosed_words(found)}")
    adopted, why = adopted_effects(found)
    progress.say(why)
    after = None
    if adopted:
        richer = with_effects(plant, tuple(each.term(robot, NAMED) for each in adopted))
        after = _compared(Subject.of_plant(ADOPTED, richer), held_out, seed, config, progress)
    return Demonstration(
        robot=robot,
        seed=seed,
        config=config,
        recordings=recordings,
        before=before,
        diagnosis=found,
        adopted=adopted,
        why=why,
        after=after,
        hidden=hidden,
        assessment=_assessed(hidden, found),
        seconds=time.perf_counter() - begun,
    )


def compared_words(found: Comparison) -> str:
    """Size and main places of a model's error, in sentences."""
    (model,) = found.models
    words = sentence(found, model)
    if model.outcome is Outcome.NOISE_ONLY:
        return words
    worst = [bins.labels[bins.worst(1)[0]] for bins in model.bins if bins.by in PLACES]
    return f"{words} Its error is largest at {' and '.join(worst)}."


def _recorded(
    robot: Robot, effect: str, seed: int, config: DemoConfig, progress: Progress
) -> tuple[Episode, ...]:
    """Measurements of a stand-in with an effect under command scripts."""
    scripts = config.scripts
    stand_in = StandInConfig(hidden=() if effect == NOTHING else (effect,))
    with progress.stage("record", len(scripts)) as stage:
        link = open_link(SIMULATED, robot, config.dt, stand_in)
        try:
            seeds = np.random.default_rng(seed).integers(SEEDS, size=len(scripts)).tolist()
            recordings = tuple(
                _recording(link, robot, number, scripts[number], own, config, stage)
                for number, own in enumerate(seeds)
            )
        finally:
            link.close()
    progress.say(
        f"The robot was recorded {len(scripts)} times for {config.seconds:g} s; {config.held_out} "
        "of these recordings are held out, and not used for fitting."
    )
    return recordings


def _recording(
    link: RobotLink,
    robot: Robot,
    number: int,
    plan: tuple[str, Split],
    seed: int,
    config: DemoConfig,
    stage: Stage,
) -> Episode:
    """One recording; `number` counts the earlier ones."""
    name, split = plan
    rng = np.random.default_rng((seed, COMMANDS))
    controls = script(name, robot, config.seconds, config.dt, rng)
    controller = Playback(robot, controls, name)
    about = Provenance(
        robot=robot.digest,
        source="recording",
        dataset="recording",
        controller=controller.name,
        seed=seed,
        code=__version__,
    )
    driven = drive(
        link,
        robot,
        controller,
        lambda points: None,
        EpisodeOrder(f"demo-{number}", about, config.seconds, seed, split),
        reckoning=Reckoning(robot, config.dt),
        on_step=lambda done, sample: stage.update(number + done / len(controls), name),
    )
    if driven.ended == "stopped":
        raise KeyboardInterrupt
    if driven.ended != "time":
        raise LinkError(driven.why)
    return driven.episode


def _compared(
    subject: Subject,
    recordings: Mapping[str, Trajectory],
    seed: int,
    config: DemoConfig,
    progress: Progress,
) -> Comparison:
    with progress.stage("compare", 1.0):
        options = ComparisonOptions(config.horizon, config.draws, seed)
        found = compare([subject], list(recordings.values()), options, list(recordings))
    progress.say(f"{found.models[0].outcome}: {compared_words(found)}")
    return found


def adopted_effects(found: Diagnosis) -> tuple[tuple[WrittenTerm, ...], str]:
    """Effects of an answer to add to a plant, and the reason; none if several answers fit equally
    well, or none helps.
    """
    try:
        effects = adoptable(found.summary())
    except DataError as error:
        return (), f"Nothing is adopted. {error}"
    errors = found.held_out
    assert errors is not None, "a demonstration holds recordings out"
    labels = ", ".join(effect.label for effect in effects)
    return effects, (
        f"{labels} is adopted: on the held-out recordings, with only the starts fitted, the error "
        f"falls from {1000 * errors.baseline:.2f} to {1000 * errors.augmented:.2f} mm (noise: "
        f"{1000 * errors.noise:.2f} mm)."
    )


def _assessed(hidden: EffectTruth | None, found: Diagnosis) -> Assessment:
    smallest = float("nan")
    if hidden is not None:
        values = library_values(hidden)
        smallest = smallest_shown(found.ranking, hidden.name, hidden.place, values)
    answers = [[(each.effect, each.location) for each in answer] for answer in found.answers]
    return assess(hidden, found.verdict, answers, smallest)
