"""From a hidden effect to a better network.

python pipelines/adoption.py --help
"""

from benchmarks.adoption import main

if __name__ == "__main__":
    main()
