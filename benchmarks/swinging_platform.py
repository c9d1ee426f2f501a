"""A real platform that swings on four locked cables: a public log without commands, diagnosed.

    git clone https://github.com/fzoffoli/OCDPR_SelfCalibration CHECKOUT
    git clone https://github.com/IRMA-LAB/cdpr_matlab GEOMETRY
    git -C GEOMETRY show ff9689c:config/Grab_prototype_44.json > grab44.json
    python -m benchmarks.swinging_platform CHECKOUT grab44.json FOLDER
    cd FOLDER
    flywheel robot adapt swing4.yaml --yes
    flywheel diagnose monday.yaml tuesday.yaml --held-out friday.yaml --robot swing4.xml --window 1

Both repositories are under the GPL; nothing of them is copied into this project, and into FOLDER only what a
user would type: where cables begin and end, and which file is which day. The logs are poses of the platform,
ten seconds each at 100 Hz, after a push by hand; winches are locked and not measured. The geometry has
pulleys of 2 cm that swivel: exit points are where the cables leave them in the first log's mean pose. Mass
and inertia are those of the drawing (Grab_prototype_44_nominal.json), which has the centre of mass at the
height of the cables' ends; authors4.yaml has what the authors identified from fifteen such logs.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from benchmarks.command import parser_of
from flywheel.files import yaml_text
from flywheel.records import Floats

RUNS = "apps/dynamic_identification"
LOGS = {"monday": 10, "tuesday": 13, "friday": 14}
RATE = 100.0  # of the poses [Hz]
MASS = 8.0064  # of the drawing; swinging does not tell it [kg]
INERTIA = (0.14, 0.14, 0.22)  # of the drawing [kg m^2]
CABLES = {"stiffness": 1e5, "damping": 150.0}  # guessed: .3 mm longer by the weight [N/m, N s/m]


def exit_point(pulley: Mapping[str, Any], end: Floats) -> Floats:
    """Place (3,) where a cable to `end` (3,) leaves a pulley that swivels about its `vers_k` [m]."""
    i, j, k, begin = (
        np.ravel(pulley[name]) for name in ("vers_i", "vers_j", "vers_k", "pos_OD_glob")
    )
    radius, beside = pulley["radius"], end - begin
    swivel = np.arctan2(j @ beside, i @ beside)
    out = i * np.cos(swivel) + j * np.sin(swivel)
    rise, run = k @ beside, out @ beside
    wrapped = 2 * np.arctan(rise / run + np.sqrt(1 - 2 * radius / run + (rise / run) ** 2))
    return np.asarray(begin + radius * (out * (1 + np.cos(wrapped)) + k * np.sin(wrapped)))


def platform(pose: Floats, geometry: Mapping[str, Any]) -> dict[str, Any]:
    """The structure: a platform whose cables end where the pulleys let go of them at a pose (6,) [m, rad]."""
    used = [each for each in geometry["actuator"] if each["active"]]
    ends = np.array([np.ravel(each["winch"]["pos_PA_loc"]) for each in used])
    there = Rotation.from_euler("XYZ", pose[3:]).apply(ends) + pose[:3]
    exits = [exit_point(each["pulley"], end) for each, end in zip(used, there, strict=True)]
    return {
        "mass": MASS,
        "inertia": list(INERTIA),
        "com": _rounded([0.0, 0.0, ends[:, 2].mean()]),
        "position": _rounded(pose[:3]),
        "exit_points": [_rounded(each) for each in exits],
        "attachment_points": [_rounded(each) for each in ends],
        "cables": CABLES,
    }


def authors(runs: Path) -> dict[str, Any]:
    """Centre of mass [m] and inertia about it [kg m^2] that the authors identified, with a known mass."""
    # Of their ten numbers the first is the mass; the next six are the centre of mass, and moments about the
    # origin of the platform's frame.
    x, y, z, *about = loadmat(runs / "res_opt.mat")["X_opt"].ravel()[1:7]
    steiner = np.array([y * y + z * z, x * x + z * z, x * x + y * y])
    return {
        "com": _rounded(np.array([x, y, z])),
        "inertia": _rounded(MASS * (np.array(about) - steiner)),
    }


def log_map(path: str, cables: int) -> dict[str, Any]:
    """The map of a log: poses in an array, and winches that never moved."""
    columns = [f"p[{i}]" for i in range(6)]
    pose = {"position": columns[:3], "rotation": columns[3:], "order": "XYZ", "unit": "rad"}
    return {
        "files": [{"path": path, "rate": RATE}],
        "poses": {"platform": pose},
        "units": {"points": "m"},
        "commands": {f"exit{i}_attachment{i}_winch": "hold" for i in range(cables)},
    }


def _rounded(values: Sequence[float] | Floats) -> list[float]:
    return [round(float(value), 6) for value in values]


def main() -> None:
    """Write the structure and the maps, and print the authors' answer."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("checkout", type=Path)
    parser.add_argument("geometry", type=Path)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    runs = given.checkout / RUNS
    paths = {day: runs / f"data_opt/44_exp_{number}.mat" for day, number in LOGS.items()}
    pose = loadmat(paths["monday"])["p"].mean(axis=1)
    robot = platform(pose, json.loads(given.geometry.read_text()))
    given.folder.mkdir(parents=True, exist_ok=True)
    for day, path in paths.items():
        values = log_map(os.path.relpath(path, given.folder), len(robot["exit_points"]))
        (given.folder / f"{day}.yaml").write_text(yaml_text(values))
    known = authors(runs)
    for name, values in (("swing4", robot), ("authors4", robot | known)):
        (given.folder / f"{name}.yaml").write_text(yaml_text(values))
    print(
        f"The authors' centre of mass is at {known['com']} m, the drawing's at {robot['com']} m; their "
        f"inertia is {known['inertia']} kg m^2, the drawing's {robot['inertia']}."
    )


if __name__ == "__main__":
    main()
