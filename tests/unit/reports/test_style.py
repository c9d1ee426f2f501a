"""The style of figures."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from flywheel.reports import style
from tests import draws


@pytest.mark.parametrize("which", ["x", "y"])
def test_a_short_logarithmic_axis_has_plain_labels(which):
    rng = np.random.default_rng(draws.seed())
    low = float(rng.uniform(0.3, 30.0))
    high = low * float(rng.uniform(1.02, 9.0))
    figure = Figure(figsize=(6.0, 6.0))
    axes = figure.add_subplot()
    axes.plot([low, high], [low, high])

    axis = axes.xaxis if which == "x" else axes.yaxis
    style.logarithmic(axis)
    figure.canvas.draw()

    assert axis.get_scale() == "log"
    from_to = sorted(axis.get_view_interval())
    ticks = zip(axis.get_ticklocs(minor=False), axis.get_majorticklabels(), strict=True)
    minor = zip(axis.get_ticklocs(minor=True), axis.get_minorticklabels(), strict=True)
    labels = [
        label.get_text()
        for place, label in (*ticks, *minor)
        if from_to[0] <= place <= from_to[1] and label.get_text()
    ]
    assert labels
    assert all("e" not in label and "times" not in label for label in labels), labels
    assert all(low / 2 <= float(label) <= 2 * high for label in labels), labels


@pytest.mark.parametrize(("low", "high"), [(-0.5, 0.5), (-0.5, 1.5), (20, 40), (0, 7000)])
def test_what_is_counted_has_ticks_at_whole_numbers_alone(low, high):
    axes = Figure().add_subplot()
    axes.set_xlim(low, high)
    style.whole_numbers(axes.xaxis)
    ticks = [tick for tick in axes.get_xticks() if low <= tick <= high]
    assert ticks and all(float(tick).is_integer() for tick in ticks)
