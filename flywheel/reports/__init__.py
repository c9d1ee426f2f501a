"""Figures and pages for people."""

from flywheel.reports.figures import FIGURES, draw, write_figures
from flywheel.reports.page import write_page, write_report

__all__ = ["FIGURES", "draw", "write_figures", "write_page", "write_report"]
