"""One driver process for the chaos runs: `python -m tests.chaos.driver CONFIG FOLDER [KEY=VALUE...]`.

Resumes whatever is in the folder, publishes nothing, and tells with its exit code how it ended.
"""

import sys

from flywheel.cli.exits import INTERRUPTED
from flywheel.errors import FlywheelError
from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.loop import run
from flywheel.runtime.pool.interrupts import Interrupted
from flywheel.runtime.pool.progress import Lines

if __name__ == "__main__":
    path, folder, *overrides = sys.argv[1:]
    say = Lines(lambda line: sys.stderr.write(line + "\n"), every=5.0)
    try:
        run(load_config(path, overrides), folder, resume=True, tracked=False, progress=say)
    except Interrupted as stopped:
        sys.stderr.write(f"{stopped}\n")
        sys.exit(INTERRUPTED)
    except FlywheelError as error:
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
        sys.exit(1)
