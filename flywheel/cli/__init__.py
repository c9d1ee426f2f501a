"""The `flywheel` command.

`flywheel NAME` is `flywheel/cli/NAME.py`: its options, declared once, and its action. `app.py` makes
commands of functions, `main.py` combines them; `options.py` has shared options, `exits.py` the end of
each command.

MuJoCo, PyTorch, Ray and MLflow are imported inside the functions that need them, so that `--help`
and a message about a wrong option are instant.
"""
