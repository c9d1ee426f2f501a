"""The errors of this package, by cause.

Every message gives the fault, the value, and the allowed values.
"""


class FlywheelError(Exception):
    """Base of every error this project raises on purpose."""


class RobotError(FlywheelError):
    """An MJCF that cannot be used as a cable-driven robot.

    Attributes:
      problems: each of them by itself, if there are several.
    """

    problems: tuple[str, ...] = ()


class MjcfError(RobotError):
    """A text that is not an MJCF: not XML, too large to compile, or with invalid numbers."""


class DataError(FlywheelError):
    """Unusable trajectories, recordings or stored bytes."""


class ConfigError(FlywheelError):
    """An invalid configuration, or one that does not fit its run."""


class ModelError(FlywheelError):
    """A dynamics model that does not fit its robot or data, or has a non-finite prediction."""


class WeightsError(ModelError):
    """Files of weights that are missing or damaged, or belong to another robot or plant."""


class LinkError(FlywheelError):
    """A robot that cannot be reached, rejects a request, or gives an invalid answer."""


class RunError(FlywheelError):
    """A run that cannot continue: workers gone, disk full, too few episodes. Finished work is kept."""


class UnknownNameError(FlywheelError, KeyError):
    """A name that is in no registry."""

    def __str__(self) -> str:  # KeyError would print the repr of the message
        return str(self.args[0])
