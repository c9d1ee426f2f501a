"""Progress of plant and network on the recordings, effect by effect."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flywheel.reports import style
from flywheel.results import RunResult

MILLI = 1000.0


def ladder_over_iterations(run: RunResult) -> Figure | None:
    """Errors of plant and networks on recordings, from iteration to iteration."""
    results = run.of_arm("mppi")
    if not any(result.diagnosis is not None for result in results):
        return None
    figure = Figure(figsize=(9.5, 3.4))
    plant, network = figure.subplots(1, 2)
    _plant(plant, run)
    _network(network, run)
    for axes in (plant, network):
        axes.set_ylim(bottom=0)
        style.whole_steps(axes, [result.iteration for result in results])
        axes.legend(loc="lower left")
    return figure


def _plant(axes: Axes, run: RunResult) -> None:
    """Root mean square with fitted starts; a step down is labelled with the added effect."""
    notes = {t.iteration: t.diagnosis for t in run.of_arm("mppi") if t.diagnosis is not None}
    first = min(notes)
    fitted, held_out = (
        {first - 1: notes[first].baseline},
        {first - 1: notes[first].held_out_baseline},
    )
    for iteration, note in notes.items():
        fitted[iteration] = note.augmented if note.adopted else note.baseline
        held_out[iteration] = note.held_out_augmented if note.adopted else note.held_out_baseline
        if note.adopted:
            before = {e.label for e in run.effects_before(iteration)}
            added = [e.label for e in note.effects if e.label not in before] or ["fitted anew"]
            axes.annotate(
                "+ " + ", ".join(added),
                (iteration, MILLI * fitted[iteration]),
                xytext=(4, 30),
                textcoords="offset points",
                ha="right",
            )
    axes.plot(list(fitted), [MILLI * e for e in fitted.values()], "o-", color=style.MPPI,
              label="fitted")  # fmt: skip
    known = {i: MILLI * e for i, e in held_out.items() if e is not None}
    if known:
        axes.plot(list(known), list(known.values()), "s--", color=style.CONTROL, label="held out")
    noise = MILLI * notes[max(notes)].noise
    axes.axhline(noise, color=style.ORACLE, linestyle=(0, (5, 2)), linewidth=1.4, label="noise")
    axes.set_title("The plant, on recordings")
    axes.set_ylabel("measured minus predicted [mm]")


def _network(axes: Axes, run: RunResult) -> None:
    for arm in run.arms:
        scored = [t for t in run.of_arm(arm) if t.recordings is not None]
        errors = [t.recordings.short.e_pos_rmse for t in scored if t.recordings is not None]
        axes.plot(
            [t.iteration for t in scored],
            errors,
            f"{style.ARM_MARKERS[arm]}-",
            color=style.ARM_COLOURS[arm],
            label=style.ARM_NAMES[arm],
        )
    if run.persistence_on_recordings is not None:
        still = run.persistence_on_recordings.short.e_pos_rmse
        axes.axhline(still, **style.PERSISTENCE_LINE, label="nothing moves")
    axes.set_title("Networks, on recordings kept for tests")
    axes.set_ylabel("e_pos RMSE/L [%]")
