"""A diagnosis compared with fitting all of an MJCF's numbers with `mujoco.sysid`.

python pipelines/sysid.py --help
"""

from benchmarks.sysid.__main__ import main

if __name__ == "__main__":
    main()
