"""`flywheel robot reveal`: the hidden physics of a run's stand-in, compared with the identified effects."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from flywheel.cli.console import console, table

if TYPE_CHECKING:
    from flywheel.effects import WrittenTerm
    from flywheel.robot_link import StandInConfig
    from flywheel.truth_simulator.effect import EffectTruth


def reveal(run: Annotated[Path, "RUN"]) -> None:
    """Show the hidden physics of a run's stand-in, which only the stand-in knew until now.

    [bold]Example[/bold]

    flywheel robot reveal runs/prism3

    Args:
      run: Folder of a run with a robot.
    """
    from flywheel.cli.runs.opening import open_run
    from flywheel.errors import DataError
    from flywheel.runtime.config.robot_config import read_stand_in
    from flywheel.truth_simulator.written import hidden_effects

    opened, out = open_run(run), console()
    stand_in = read_stand_in(opened.folder.robot_folder)
    if stand_in is None:
        raise DataError(f"The run in {run} has no stand-in: nothing was hidden in its robot.")
    hidden = [
        effect.truth(opened.robot) for effect in hidden_effects(stand_in.hidden, opened.robot)
    ]
    found = opened.result.effects_before(opened.config.iterations + 1)
    rows = [
        (_named(truth), _numbers(truth.values, truth.units), _found(truth, found))
        for truth in hidden
    ]
    rows += [
        (effect.label, "not there", _written(effect))
        for effect in found
        if effect.label not in {_named(truth) for truth in hidden}
    ]
    out.print(
        table("Effects", ["effect", "hidden", "found"], rows) if rows else "Nothing was hidden."
    )
    out.print(_sensors(stand_in))


def _named(truth: EffectTruth) -> str:
    """In the format of `WrittenTerm.label`."""
    return f"{truth.name} at {truth.place}" if truth.place else truth.name


def _found(truth: EffectTruth, found: tuple[WrittenTerm, ...]) -> str:
    same = [effect for effect in found if effect.label == _named(truth)]
    return _written(same[0]) if same else "no"


def _written(effect: WrittenTerm) -> str:
    return _numbers(effect.parameters, {})


def _numbers(values: dict[str, float], units: dict[str, str]) -> str:
    words = (f"{n} {v:.4g} {units.get(n, '').replace('-', '')}".rstrip() for n, v in values.items())
    return ", ".join(words)


def _sensors(stand_in: StandInConfig) -> str:
    rate = f"{stand_in.rate:g} Hz" if stand_in.rate else "every control period"
    told = "told" if stand_in.latency_told else "not told"
    return (
        f"Points were measured at {rate}, with noise of {stand_in.noise:.2%} of the length; they arrived "
        f"{stand_in.latency:g} s late ({told}), and {stand_in.dropout:.0%} were missing."
    )
