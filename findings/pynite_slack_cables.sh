#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" PyNiteFEA==3.2.0 numpy==2.4.6
echo "guess:     tension-only members end in equilibrium: those that the solution stretches pull, the others are slack"
echo "behaviour: one that was slack in an early round stays so: it is stretched by 3.5 mm/m at the end, and carries nothing"
python - <<'PYTHON'
from itertools import product

import numpy as np
from Pynite import FEModel3D

ANCHORS, LOAD, EA = np.array([[1.0, 4], [1, 3], [2, -4], [-4, -4]]), np.array([2000.0, -1000]), 1e6
lengths = np.linalg.norm(ANCHORS, axis=1)
towards = ANCHORS / lengths[:, None]

model = FEModel3D()
model.add_material("steel", 1e9, 4e8, 0.3, 0.0)
model.add_section("cable", EA / 1e9, 1e-9, 1e-9, 1e-9)
model.add_node("ring", 0, 0, 0)
model.def_support("ring", False, False, True, True, True, True)
for number, (x, y) in enumerate(ANCHORS):
    model.add_node(f"wall {number}", x, y, 0)
    model.def_support(f"wall {number}", True, True, True, True, True, True)
    model.add_member(f"cable {number}", f"wall {number}", "ring", "steel", "cable", tension_only=True)
    model.def_releases(f"cable {number}", Ryi=True, Rzi=True, Ryj=True, Rzj=True)
model.add_node_load("ring", "FX", LOAD[0])
model.add_node_load("ring", "FY", LOAD[1])
model.analyze()
ring = model.nodes["ring"]
moved = np.array([ring.DX["Combo 1"], ring.DY["Combo 1"]])
strains = -towards @ moved / lengths
tensions = np.array([-model.members[f"cable {number}"].min_axial() for number in range(4)])

# The right answer, from all 16 choices of cables that pull: these are stretched, and the others are not.
answers = []
for pulling in product([False, True], repeat=4):
    stiffness = np.diag(np.where(pulling, EA / lengths, 0))
    matrix = towards.T @ stiffness @ towards
    if np.linalg.matrix_rank(matrix) == 2:
        stretch = -towards @ np.linalg.solve(matrix, LOAD)
        if ((stretch > 0) == pulling).all():
            answers.append(np.diag(stiffness) * stretch)
print(f"seen:      tensions {tensions.round().tolist()} N at strains of {(1e3 * strains).round(2).tolist()} mm/m;")
print(f"           the only equilibrium has {answers[0].round().tolist()} N")
assert len(answers) == 1 and answers[0][1] > 1700 and strains[1] > 0.003 and abs(tensions[1]) < 1e-6, "this has changed"
PYTHON
