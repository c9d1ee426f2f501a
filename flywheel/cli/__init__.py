"""The `flywheel` command.

`flywheel NAME` is `flywheel/cli/NAME.py`: its options, declared once, and what it does. `main.py` puts the
commands together; `options.py` has what several of them take, `exits.py` how each of them ends.

MuJoCo, PyTorch, Ray and MLflow are imported inside the functions that need them, so that `--help` and a
message about a wrong option are instant.
"""
