"""Training: curriculum, loss, checkpoints, and selection by validation rollouts."""

from flywheel.training.config import Schedule, Stage, TrainingConfig
from flywheel.training.progress import TrainingProgress
from flywheel.training.trainer import Trainer

__all__ = ["Schedule", "Stage", "Trainer", "TrainingConfig", "TrainingProgress"]
