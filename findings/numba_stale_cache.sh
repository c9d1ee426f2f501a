#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" numba==0.68.1 llvmlite==0.50.0 numpy==2.4.6
echo "guess:     a function that is compiled with cache=True is compiled anew when a function that it calls has changed"
echo "behaviour: only a change of its own file counts; it goes on with what the other file contained before"
mkdir code
cat > code/kernel.py <<'PYTHON'
from numba import njit

from helper import double


@njit(cache=True)
def kernel(x):
    return double(x)
PYTHON
write() { printf 'from numba import njit\n\n\n@njit\ndef double(x):\n    return %s * x\n' "$1" > code/helper.py; }
call() { PYTHONPATH=code python -c "from helper import double; from kernel import kernel; print(kernel(1.0), double(1.0))"; }
write 2.0
before="$(call)"
write 3.00
after="$(call)"
printf '# changed\n' >> code/kernel.py
changed="$(call)"
echo "seen:      kernel and what it calls give $before; after a change of the latter $after; after one of the former $changed"
[[ "$before" == "2.0 2.0" && "$after" == "2.0 3.0" && "$changed" == "3.0 3.0" ]] || { echo "this has changed"; exit 1; }
