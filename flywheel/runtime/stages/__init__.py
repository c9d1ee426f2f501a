"""The six stages of an iteration, one module each, and the records passed between them.

`record` combines their outcomes as an `IterationResult`. Every stage first checks for existing
results, so that a killed run continues where it stopped.
"""

from flywheel.runtime.stages.collect import collect
from flywheel.runtime.stages.decide import decide
from flywheel.runtime.stages.diagnose import diagnose
from flywheel.runtime.stages.evaluate import evaluate
from flywheel.runtime.stages.outcomes import Iteration
from flywheel.runtime.stages.record import record
from flywheel.runtime.stages.snapshot import snapshot
from flywheel.runtime.stages.train import train

__all__ = ["Iteration", "collect", "decide", "diagnose", "evaluate", "record", "snapshot", "train"]
