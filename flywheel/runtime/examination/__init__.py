"""Examine the diagnosis on recordings with a known answer."""

from flywheel.runtime.examination.publishing import publish_examination
from flywheel.runtime.examination.results import Answer, CaseResult, Named
from flywheel.runtime.examination.summary import Line, summary
from flywheel.runtime.examination.worker import Examiner

__all__ = ["Answer", "CaseResult", "Examiner", "Line", "Named", "publish_examination", "summary"]
