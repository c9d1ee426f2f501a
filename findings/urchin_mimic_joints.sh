#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" urchin==0.0.30 numpy==2.4.6
echo "guess:     link_fk() without a configuration is that of zeros, and a joint that mimics a mimicking joint moves with it"
echo "behaviour: without a configuration offsets of mimic joints are 0, too; a joint that mimics a mimicking one never moves"
cat > robot.urdf <<'XML'
<robot name="gripper"><link name="base"/><link name="drum"/><link name="left"/><link name="right"/>
<joint name="turn" type="continuous"><parent link="base"/><child link="drum"/><axis xyz="0 0 1"/></joint>
<joint name="slide_left" type="prismatic"><parent link="base"/><child link="left"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/><mimic joint="turn" multiplier="0.5" offset="0.25"/></joint>
<joint name="slide_right" type="prismatic"><parent link="base"/><child link="right"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/><mimic joint="slide_left" multiplier="-1" offset="0"/></joint></robot>
XML
python -W ignore - <<'PYTHON'
import urchin

robot = urchin.URDF.load("robot.urdf")


def places(configuration=None):
    """Places [m] of the two fingers along x."""
    poses = robot.link_fk(configuration, use_names=True)
    return [round(float(poses[name][0, 3]), 6) for name in ("left", "right")]


bare, zero, one = places(), places({"turn": 0.0}), places({"turn": 1.0})
print(f"seen:      left and right finger, 0.25 + 0.5 turn and minus that: without a configuration {bare}, turn = 0 {zero}, turn = 1 {one}")
assert bare == [0, 0] and zero == [0.25, 0] and one == [0.75, 0], "this has changed"
PYTHON
