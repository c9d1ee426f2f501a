"""How well MPPI does when its model is the plant itself.

python pipelines/oracle.py --help
"""

from benchmarks.oracle import main

if __name__ == "__main__":
    main()
