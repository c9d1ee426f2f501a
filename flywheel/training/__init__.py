"""Training: curriculum, loss, checkpoints, and selection by validation rollouts."""

from flywheel.training.config import Schedule, Stage, TrainingConfig
from flywheel.training.progress import CurvePoint, TrainingProgress, TrainingResult
from flywheel.training.trainer import WEIGHTS, Trainer
from flywheel.training.validation import SELECTION, selection_error

__all__ = [
    "SELECTION",
    "WEIGHTS",
    "CurvePoint",
    "Schedule",
    "Stage",
    "Trainer",
    "TrainingConfig",
    "TrainingProgress",
    "TrainingResult",
    "selection_error",
]
