"""Compare models on trajectories, as a table.

python pipelines/paper_table.py --help
"""

from benchmarks.paper.__main__ import main

if __name__ == "__main__":
    main()
