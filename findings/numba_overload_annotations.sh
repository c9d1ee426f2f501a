#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" numba==0.68.1 llvmlite==0.50.0 numpy==2.4.6
echo "guess:     numba ignores annotations: an overload and the implementation that it returns need only the same argument names"
echo "behaviour: annotated arguments of one and bare ones of the other are refused, as arguments that differ in their names"
cat > try.py <<'PYTHON'
from typing import Any

import numpy as np
from numba import njit
from numba.core.errors import NumbaError
from numba.extending import overload


def attempt(outer_annotated, inner_annotated):
    def first(row):
        raise NotImplementedError

    def bare(row):
        return row[0]

    def annotated(row: Any) -> Any:
        return row[0]

    chosen = annotated if inner_annotated else bare
    if outer_annotated:

        @overload(first)
        def compiled(row: Any) -> Any:
            return chosen
    else:

        @overload(first)
        def compiled(row):
            return chosen

    try:
        return njit(lambda rows: first(rows))(np.ones(2))
    except NumbaError as error:
        said = "differ in argument names"
        return said if said in str(error) else type(error).__name__


print("; ".join(str(attempt(a, b)) for a in (False, True) for b in (False, True)))
PYTHON
found="$(python try.py)"
echo "seen:      (overload, implementation) bare and bare, bare and annotated, annotated and bare, both annotated: $found"
bad="differ in argument names"
[[ "$found" == "1.0; $bad; $bad; 1.0" ]] || { echo "this has changed"; exit 1; }
