#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" gekko==1.3.3 numpy==2.4.6
echo "guess:     in a simulation (IMODE=4) the equation y = 2 u + 1 holds at each time, the first one included"
echo "behaviour: not at the first: y is its start value there, 0 if none was given, and the solution counts as successful"
python - <<'PYTHON'
import numpy as np
from gekko import GEKKO


def simulated(**start):
    """Values of y at six times."""
    model = GEKKO(remote=False)
    model.time, model.options.IMODE = np.linspace(0, 1, 6), 4
    command, force = model.Param(value=[1, 2, 3, 4, 5, 6]), model.Var(**start)
    model.Equation(force == 2 * command + 1)
    model.solve(disp=False)
    assert model.options.APPSTATUS == 1
    return list(force.value)


seen, given = simulated(), simulated(value=3)
print(f"seen:      y for u from 1 to 6: {seen}; with the start value 3: {given}")
assert seen == [0, 5, 7, 9, 11, 13] and given == [3, 5, 7, 9, 11, 13], "this has changed"
PYTHON
