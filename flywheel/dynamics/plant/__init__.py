"""The plant: MuJoCo as simulated robot, its measurement, and MuJoCo as a model."""

from flywheel.dynamics.plant.augmented import AugmentedPlant, Motion
from flywheel.dynamics.plant.drawing import Scenery
from flywheel.dynamics.plant.effective import EffectivePlant, with_effects
from flywheel.dynamics.plant.following import cables_by_winches
from flywheel.dynamics.plant.live import LiveView
from flywheel.dynamics.plant.measurement import MeasurementModel
from flywheel.dynamics.plant.oracle import PlantDynamics
from flywheel.dynamics.plant.parameters import PlantParameters
from flywheel.dynamics.plant.plant import Plant
from flywheel.dynamics.plant.reckoning import Reckoning
from flywheel.dynamics.plant.refined import hasty, refined
from flywheel.dynamics.plant.render import Film, Shot, write_video
from flywheel.dynamics.plant.restarted import RestartedPlant, states_of
from flywheel.dynamics.plant.resting import Settling, settling, swing_period
from flywheel.dynamics.plant.roll import unseen_axes
from flywheel.dynamics.plant.tangent import between, moved, turning
from flywheel.dynamics.plant.time_steps import StepError, StepStudy, cable_damping

__all__ = [
    "AugmentedPlant",
    "EffectivePlant",
    "Film",
    "LiveView",
    "MeasurementModel",
    "Motion",
    "Plant",
    "PlantDynamics",
    "PlantParameters",
    "Reckoning",
    "RestartedPlant",
    "Scenery",
    "Settling",
    "Shot",
    "StepError",
    "StepStudy",
    "between",
    "cable_damping",
    "cables_by_winches",
    "hasty",
    "moved",
    "refined",
    "settling",
    "states_of",
    "swing_period",
    "turning",
    "unseen_axes",
    "with_effects",
    "write_video",
]
