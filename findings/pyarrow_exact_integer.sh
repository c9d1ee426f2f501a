#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pyarrow==25.0.1 numpy==2.4.6
echo "guess:     a cast from int64 to float64 that is safe by default fails only if a number changes; that from float64 to float32 too"
echo "behaviour: every number from 2^53 on is refused, also exact ones; float32 takes any number, changed or infinite"
python - <<'PYTHON'
import pyarrow as pa

power = 2**60
seen = []
for number, kind, target in ((power, pa.int64(), pa.float64()), (0.1, pa.float64(), pa.float32()), (1e300, pa.float64(), pa.float32())):
    try:
        seen.append(pa.array([number], kind).cast(target).to_pylist()[0])
    except pa.ArrowInvalid as error:
        seen.append(str(error))
print(f"seen:      {power}, exact in float64: {seen[0]!r}; 0.1 as float32: {seen[1]}; 1e300 as float32: {seen[2]}")
assert float(power) == power and "not in range" in seen[0], "this has changed"
assert seen[1] != 0.1 and seen[2] == float("inf"), "this has changed"
PYTHON
