"""Evaluation: statistics per sample, summed into errors by lead time and body; intervals."""

from flywheel.evaluation.errors import ErrorTable
from flywheel.evaluation.intervals import Interval, rmse_ratio_interval, success_interval
from flywheel.evaluation.pasts import past_at
from flywheel.evaluation.scoring import BINS, HISTORY_SECONDS, places, score, score_by, score_full
from flywheel.evaluation.statistics import (
    rotation_error,
    squared_point_error,
    squared_position_error,
)
from flywheel.evaluation.sums import ExactSum

__all__ = [
    "BINS",
    "HISTORY_SECONDS",
    "ErrorTable",
    "ExactSum",
    "Interval",
    "past_at",
    "places",
    "rmse_ratio_interval",
    "rotation_error",
    "score",
    "score_by",
    "score_full",
    "squared_point_error",
    "squared_position_error",
    "success_interval",
]
