"""Surroundings of a robot: gravity."""

from __future__ import annotations

GRAVITY = 9.81  # for natural units; a simulation takes the MJCF's [m/s^2]
