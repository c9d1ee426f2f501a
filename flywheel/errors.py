"""The errors a user can meet, by what went wrong.

Every message says what is wrong, what was got, and what is allowed.
"""


class FlywheelError(Exception):
    """Base of every error this project raises on purpose."""


class RobotError(FlywheelError):
    """An MJCF that cannot be used as a cable-driven robot."""


class MjcfError(RobotError):
    """A text that is no MJCF of anything: not XML, more than is compiled, or with numbers that are none."""


class DataError(FlywheelError):
    """Trajectories, recordings or stored bytes that cannot be used as they are."""


class ConfigError(FlywheelError):
    """A configuration that is not valid, or does not fit the run it is used with."""


class ModelError(FlywheelError):
    """A dynamics model that does not fit its robot or data, or predicts no finite number."""


class LinkError(FlywheelError):
    """A robot that cannot be reached, refuses, or answers with what cannot be understood."""


class RunError(FlywheelError):
    """A run that cannot go on: workers gone, disk full, too few episodes. Finished work is kept."""


class UnknownNameError(FlywheelError, KeyError):
    """A name that is in no registry."""

    def __str__(self) -> str:  # KeyError would print the repr of the message
        return str(self.args[0])
