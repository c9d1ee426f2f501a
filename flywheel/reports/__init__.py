"""Figures and pages for people."""

from flywheel.reports.page import write_page, write_report

__all__ = ["write_page", "write_report"]
