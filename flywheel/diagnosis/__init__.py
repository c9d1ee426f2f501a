"""Find out which physical effect a plant lacks to explain recordings."""

from flywheel.diagnosis.diagnose import diagnose
from flywheel.diagnosis.diagnosis import Diagnosis
from flywheel.diagnosis.limits import Limits
from flywheel.diagnosis.noise import noise_floor
from flywheel.diagnosis.verdict import EXIT_CODES, Found, Verdict

__all__ = [
    "EXIT_CODES",
    "Diagnosis",
    "Found",
    "Limits",
    "Verdict",
    "diagnose",
    "noise_floor",
]
