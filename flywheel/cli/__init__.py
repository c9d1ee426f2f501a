"""The `flywheel` command.

`flywheel NAME` is `flywheel/cli/NAME.py`: its options, declared once, and its action. `main.py`
combines the commands; `options.py` has shared options, `exits.py` the end of each command.

MuJoCo, PyTorch, Ray and MLflow are imported inside the functions that need them, so that `--help`
and a message about a wrong option are instant.
"""
