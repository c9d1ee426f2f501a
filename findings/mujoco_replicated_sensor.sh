#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0
echo "guess:     <replicate> copies what refers to its elements; a <clock> refers to none, and stays one"
echo "behaviour: with each copy all clocks so far are doubled: 2^n of them for n copies"
python - <<'PYTHON'
import mujoco

MJCF = """<mujoco>
  <worldbody><replicate count="{}" offset="1 0 0"><site name="s"/></replicate></worldbody>
  <sensor><clock name="c"/></sensor>
</mujoco>"""

counts = {n: mujoco.MjModel.from_xml_string(MJCF.format(n)).nsensor for n in (1, 2, 4, 8)}
print(f"seen:      clocks by number of copies: {counts}")
assert counts == {1: 2, 2: 4, 4: 16, 8: 256}, "this has changed"
PYTHON
