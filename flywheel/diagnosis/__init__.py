"""Identify the physical effect that a plant lacks, from recordings."""

from flywheel.diagnosis.diagnose import diagnose
from flywheel.diagnosis.results.diagnosis import Diagnosis
from flywheel.diagnosis.results.verdict import EXIT_CODES, Found, Verdict
from flywheel.diagnosis.settings import Limits, Settings, changed

__all__ = [
    "EXIT_CODES",
    "Diagnosis",
    "Found",
    "Limits",
    "Settings",
    "Verdict",
    "changed",
    "diagnose",
]
