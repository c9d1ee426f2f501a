#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" --no-deps tinympc==0.0.8 numpy==2.4.6
echo "guess:     a load that rests at 0 and is to go to 1 m is commanded to go there, as one that rests at 1 m and is to go to 2 m"
echo "behaviour: never: from a state of zeros the first answer, which does not know the reference, counts as converged"
python - <<'PYTHON' | grep -v '^Solver converged'
import numpy as np
from tinympc import TinyMPC

a, b = np.array([[1, 0.1], [0, 1]]), np.array([[0.005], [0.1]])


def driven(start, goal):
    """First command [m/s2], and where the load is after 5 s [m]."""
    controller = TinyMPC()
    controller.setup(a, b, np.diag([10.0, 1.0]), np.array([[0.1]]), 20, u_min=np.array([-5.0]), u_max=np.array([5.0]))
    controller.set_x_ref(np.array([goal, 0.0]))
    controller.set_u_ref(np.zeros(1))
    state, commands = np.array([start, 0.0]), []
    for _ in range(50):
        controller.set_x0(state)
        commands.append(controller.solve()["controls"].copy())
        state = a @ state + b @ commands[-1]
    return round(float(commands[0][0]), 2), round(float(state[0]), 2)


found = {f"{start} to {goal} m": driven(start, goal) for start, goal in ((0, 1), (1, 2), (1, 0), (0.001, 1))}
print(f"seen:      first command and place after 5 s: {found}")
assert found["0 to 1 m"] == (0, 0) and found["1 to 2 m"][0] > 2 and found["1 to 2 m"][1] > 1.95, "this has changed"
assert found["1 to 0 m"][1] < 0.05 and found["0.001 to 1 m"][1] > 0.95, "this has changed"
PYTHON
