"""Good inputs, to be spoilt."""

from pathlib import Path
from typing import Any

from flywheel.diagnosis.adoption import adopt
from flywheel.diagnosis.results.answer import FORMAT
from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig, save_weights
from flywheel.robots import load_robot
from flywheel.truth_simulator.measurement import Measurement
from flywheel.truth_simulator.recording import record
from tests.unit.runtime.tiny_run import Bench

ROOT = Path(__file__).parents[2]
ROBOTS = ("prism3", "icosa6", "platform4")
CONFIGS = sorted((ROOT / "configs").glob("*.yaml"))
COURSES = sorted((ROOT / "flywheel" / "robots" / "courses").glob("*.xml"))
MAP: dict[str, Any] = {
    "columns": {"time": "time"},
    "units": {"time": "s", "points": "m", "control": "m/s", "winch": "m"},
    "axes": {"x": "x", "y": "y", "z": "z"},
    "origin": [0.0, 0.0, 0.0],
    "conditions": "new cables, concrete floor",
    "ignore": [],
    "repair": ["swaps"],
    "jitter": 0.25,
}


def log(work: Path) -> Path:
    """A log of half a second."""
    path = work / "prism3.csv"
    if not path.exists():
        robot = load_robot("prism3")
        record(robot, seconds=0.5, seed=0, measurement=Measurement()).write(work, "prism3", robot)
    return path


def answers() -> list[dict[str, Any]]:
    """Answers of diagnoses of prism3: one effect; two, and a number that nobody was sure of."""
    robot = load_robot("prism3")
    about = {
        "format": FORMAT,
        "robot": {"name": robot.name, "digest": robot.digest},
        "recordings": ["monday.csv"],
        "error": {"noise": 0.001, "baseline": 0.02, "augmented": 0.001, "unit": "m"},
        "residual": {"points": 0.002},
        "held_out": {"noise": 0.009, "baseline": 0.012, "augmented": 0.009, "unit": "m"},
    }
    gain = _found("winch_gain", share=(0.2, "-"))
    friction = _found("cable_friction", force=(300.0, "N"))
    softer = _found("cable_stiffness", share=(0.1, "-"))
    return [
        {**about, "verdict": "EFFECT", "answer_set": [[gain]], "calibration": []},
        {**about, "verdict": "PARTIAL", "answer_set": [[gain, friction]], "calibration": [softer]},
    ]


def plant(work: Path) -> Path:
    """The folder of an adopted plant of prism3."""
    there = list((work / "plants").glob("*/plant.yaml"))
    made = there[0] if there else adopt(answers()[0], load_robot("prism3"), work / "plants")
    return made.parent


def run(work: Path) -> Path:
    """The folder of a finished run with both arms, with its store."""
    bench = Bench(work / "run", control_arm=True)
    if not bench.files.path.exists():
        bench.files.path.mkdir()
        bench.turn()
    return bench.files.path


def weights(work: Path) -> Path:
    """The folder of the weights of a small network of prism3, w.npz and w.json."""
    folder = work / "weights"
    if not folder.exists():
        folder.mkdir()
        network = ChunkNetwork(load_robot("prism3"), NetworkConfig(width=8, rounds=1))
        save_weights(network, folder / "w.npz")
    return folder


def _found(effect: str, **values: tuple[float, str]) -> dict[str, Any]:
    parameters = {
        name: {"value": value, "low": 0.9 * value, "high": 1.1 * value, "unit": unit}
        for name, (value, unit) in values.items()
    }
    return {"effect": effect, "location": "", "parameters": parameters}
