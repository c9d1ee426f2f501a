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
