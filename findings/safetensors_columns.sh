#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" safetensors==0.8.0 scipy==1.17.1 numpy==2.4.6
echo "guess:     save_file writes the matrix that it is given, or refuses its layout, as the same function for torch does"
echo "behaviour: it writes the bytes in memory: a transposed matrix, and any that loadmat read, comes back shuffled"
python - <<'PYTHON'
import numpy as np
from safetensors.numpy import load_file, save_file
from scipy.io import loadmat, savemat

gains = np.array([[1.0, 2, 3], [4, 5, 6]])
savemat("robot.mat", {"gains": gains})
matrices = {"rows": gains, "transposed": gains.T, "read": loadmat("robot.mat")["gains"]}
save_file(matrices, "robot.safetensors")
loaded = load_file("robot.safetensors")
seen = [f"{name} {matrix.tolist()} became {loaded[name].tolist()}" for name, matrix in matrices.items()]
print("seen:      " + ";\n           ".join(seen))
same = {name: np.array_equal(loaded[name], matrix) for name, matrix in matrices.items()}
assert same == {"rows": True, "transposed": False, "read": False}, "this has changed"
PYTHON
