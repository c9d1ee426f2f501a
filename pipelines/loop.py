"""Run the loop.

    python pipelines/loop.py configs/prism3.yaml [KEY=VALUE ...]

The run goes into runs/<name of the configuration>; an existing one is continued.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.config.shipped import config_file
from flywheel.runtime.loop import run
from flywheel.runtime.pool.progress import console_progress


def main() -> None:
    """Collect, train, evaluate and decide, as often as configured."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("config", help="a YAML file, or a name: prism3")
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help="settings to change")
    given = parser.parse_args()
    config = load_config(config_file(given.config), given.overrides)
    run(config, Path("runs") / Path(given.config).stem, resume=True, progress=console_progress())


if __name__ == "__main__":
    main()
