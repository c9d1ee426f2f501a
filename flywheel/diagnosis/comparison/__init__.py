"""Compare dynamics models with recordings: is the error more than noise, and where is it?"""

from flywheel.diagnosis.comparison.bins import Bins
from flywheel.diagnosis.comparison.compare import compare
from flywheel.diagnosis.comparison.fitted_starts import FittedStarts
from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.diagnosis.comparison.result import Comparison, Judgement, Outcome
from flywheel.diagnosis.fitting.subject import Subject

__all__ = [
    "Bins",
    "Comparison",
    "FittedStarts",
    "ForecastWindows",
    "Judgement",
    "Outcome",
    "Subject",
    "compare",
]
