"""Find out which physical effect a plant lacks to explain recordings."""

from flywheel.diagnosis.diagnose import diagnose
from flywheel.diagnosis.fitting.noise import noise_floor
from flywheel.diagnosis.results.diagnosis import Diagnosis
from flywheel.diagnosis.results.limits import Limits
from flywheel.diagnosis.results.verdict import EXIT_CODES, Found, Verdict

__all__ = [
    "EXIT_CODES",
    "Diagnosis",
    "Found",
    "Limits",
    "Verdict",
    "diagnose",
    "noise_floor",
]
