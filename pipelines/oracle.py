"""Success of MPPI with the plant itself as model.

python pipelines/oracle.py --help
"""

from benchmarks.oracle import main

if __name__ == "__main__":
    main()
