"""`python -m flywheel.cli`: the same as `flywheel`."""

from flywheel.cli.main import app

if __name__ == "__main__":
    app(prog_name="flywheel")
