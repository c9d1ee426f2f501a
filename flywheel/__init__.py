"""Flywheel: a controller-in-the-loop data flywheel for cable-driven robots."""

__version__ = "0.1.0"
