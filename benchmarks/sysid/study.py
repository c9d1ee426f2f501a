"""`flywheel diagnose` compared with fitting the same recordings with `mujoco.sysid`, all its
parameters free.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from benchmarks.diagnosis.cases import Case, Recorded
from benchmarks.sysid.identification import Fitted, Optimizer, Piece, identify
from flywheel.diagnosis import diagnose
from flywheel.diagnosis.fitting.initial_states import estimated_initial_states
from flywheel.diagnosis.fitting.model import fitted
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.simulation import WindowSimulator
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Effect, Terms
from flywheel.records import Floats
from flywheel.results import ResultRecord
from flywheel.robots import load_robot
from flywheel.truth_simulator.effect import EffectTruth


@dataclass(frozen=True)
class Setup:
    """A way to use sysid.

    Attributes:
      starts: are fitted, too.
      iterations: maximum.
      optimizer: one of sysid's.
    """

    starts: bool
    iterations: int
    optimizer: Optimizer = "mujoco"


SETUPS = {
    "sysid, starts held": Setup(False, 10),
    "sysid, starts fitted": Setup(True, 20),
    "sysid, starts fitted, by SciPy": Setup(True, 20, "scipy_parallel_fd"),
}


class Contender(ResultRecord):
    """One way to explain the recordings.

    Attributes:
      name: of the contender.
      fit, held_out: root mean square errors with the best start of each window, over the noise.
      seconds: of one core; sysid's without the first fit of the starts, which is given.
      verdict: in a word, or the end of the fit.
      numbers: all fitted ones.
    """

    name: str
    fit: float
    held_out: float
    seconds: float = 0.0
    verdict: str = ""
    numbers: tuple[Fitted, ...] = ()


class CaseStudy(ResultRecord):
    """One case.

    Attributes:
      name: of the case.
      truth: hidden effects, in words.
      noise: of a coordinate, as estimated [m].
      contenders: the initial plant first.
    """

    name: str
    truth: str
    noise: float
    contenders: tuple[Contender, ...]


class Bench:
    """The recordings of a case in windows, and the common measure of all contenders.

    Args:
      plant: initial one.
      recorded: the recordings.
    """

    def __init__(self, plant: Plant, recorded: Recorded) -> None:
        self.plant, robot = plant, plant.robot
        self.recordings = [each.trajectory for each in recorded.fit]
        self.fit = Windows.cut(robot, self.recordings)
        seconds = self.fit.steps * self.fit.dt
        held_out = [recorded.held_out.trajectory]
        self.held_out = Windows.cut(robot, held_out, seconds, self.fit.sigma)

    def errors(self, plant: Plant, terms: Terms = ()) -> tuple[float, float]:
        """Errors of a plant with terms over the noise, on the recordings and on the one held out.

        They are measured in the same way for all contenders.
        """
        fitters = (self._fitter(windows, plant) for windows in (self.fit, self.held_out))
        on_fit, on_held_out = (f.rms(fitted(f, terms)) / self.fit.sigma for f in fitters)
        return on_fit, on_held_out

    def pieces(self) -> tuple[list[Piece], Floats]:
        """Inputs of sysid: windows, and the tolerance of their starts (2 nv,).

        The starts are those that fit the initial plant best, with winches reckoned from the
        commands.
        """
        windows, fitter = self.fit, self._fitter(self.fit, self.plant)
        predictor = fitter.simulator
        starts = predictor.with_winch(fitted(fitter).initial.mechanics, predictor.nominal)
        places = enumerate(zip(windows.recording, windows.first, strict=True))
        pieces = [
            Piece(
                starts[k],
                windows.recordings[log].controls[first : first + windows.steps],
                windows.measured[k],
            )
            for k, (log, first) in places
        ]
        return pieces, fitter.local_prior * predictor.unit

    def _fitter(self, windows: Windows, plant: Plant) -> PlantFitter:
        predictor = WindowSimulator(windows, plant)
        return PlantFitter(predictor, estimated_initial_states(windows, self.plant))


def study(
    case: Case, setups: Mapping[str, Setup] = SETUPS, library: Sequence[str] = ()
) -> CaseStudy:
    """All contenders on one case.

    Args:
      case: makes the recordings.
      setups: of sysid.
      library: candidate effects of the diagnosis; all for none.
    """
    recorded = case.record(load_robot(case.robot))
    bench = Bench(Plant(load_robot(case.robot), case.measurement.dt), recorded)
    return CaseStudy(
        name=case.name,
        truth="; ".join(_truth(each) for each in recorded.held_out.effects),
        noise=bench.fit.sigma,
        contenders=(
            _contender(bench, "plant as it was", bench.plant),
            *_by_sysid(bench, setups),
            _by_diagnosis(bench, {name: EFFECTS[name] for name in library} or EFFECTS),
        ),
    )


def _by_sysid(bench: Bench, setups: Mapping[str, Setup]) -> Iterator[Contender]:
    pieces, spread = bench.pieces()
    for name, setup in setups.items():
        begun = time.process_time()
        found = identify(
            bench.plant,
            pieces,
            bench.fit.sigma,
            spread if setup.starts else None,
            setup.iterations,
            setup.optimizer,
        )
        seconds = time.process_time() - begun
        # Not read as a robot anew: sysid's winches may have gains that a robot's MJCF may not.
        robot = replace(bench.plant.robot, xml=found.xml)
        plant = Plant(robot, bench.plant.dt)
        yield _contender(bench, name, plant, (), seconds, found.ended, found.numbers)


def _by_diagnosis(bench: Bench, library: Mapping[str, Effect]) -> Contender:
    begun = time.process_time()
    found = diagnose(bench.plant, bench.recordings, library=library)
    seconds = time.process_time() - begun
    best = found.answers[0]
    numbers = [
        Fitted(
            name=f"{each.effect}.{value.name}{each.location and f' at {each.location}'}",
            unit=value.unit,
            nominal=0.0,
            value=value.value,
            low=value.low,
            high=value.high,
        )
        for each in best
        for value in each.values
    ]
    terms = tuple(each.term for each in best)
    verdict = str(found.verdict)
    return _contender(bench, "flywheel diagnose", bench.plant, terms, seconds, verdict, numbers)


def _contender(
    bench: Bench,
    name: str,
    plant: Plant,
    terms: Terms = (),
    seconds: float = 0.0,
    verdict: str = "",
    numbers: Sequence[Fitted] = (),
) -> Contender:
    fit, held_out = bench.errors(plant, terms)
    return Contender(
        name=name,
        fit=fit,
        held_out=held_out,
        seconds=seconds,
        verdict=verdict,
        numbers=tuple(numbers),
    )


def _truth(effect: EffectTruth) -> str:
    values = ", ".join(
        f"{name} {value:.3g} {effect.units[name]}" for name, value in effect.values.items()
    )
    return f"{effect.name}{effect.place and ' at '}{effect.place}: {values}"
