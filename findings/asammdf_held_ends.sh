#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" asammdf==8.8.28 pandas==3.1.1 numpy==2.4.6
echo "guess:     in to_dataframe a channel that began late or broke off early has no values where it was not recorded"
echo "behaviour: its first and last values are held to the ends of the log, and between its samples there are lines"
python - <<'PYTHON'
import numpy as np
from asammdf import MDF, Signal

encoder, load_cell = np.arange(0, 10, 0.5), np.arange(3, 6)
log = MDF()
log.append([Signal(np.cos(encoder), encoder, name="encoder")])
log.append([Signal(np.array([20.0, 40.0, 30.0]), load_cell.astype(float), name="tension")])
log.save("log.mf4", overwrite=True)
tension = MDF("log.mf4").to_dataframe()["tension"]
print(f"seen:      samples of 20, 40, 30 N at 3, 4, 5 s; the table has {dict(zip(tension.index.tolist(), tension.tolist()))}")
assert tension.notna().all() and (tension[:2.5] == 20).all() and (tension[5.5:] == 30).all() and tension[3.5] == 30, "this has changed"
PYTHON
