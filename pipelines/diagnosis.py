"""Success rates of a diagnosis.

python pipelines/diagnosis.py --help
"""

from benchmarks.diagnosis.__main__ import app

if __name__ == "__main__":
    app()
