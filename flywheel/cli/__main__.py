"""`flywheel`, and `python -m flywheel.cli`: the commands, which take a moment to be imported."""

import signal


def main() -> None:
    """Execute the command line."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends the imports without a traceback
    from flywheel.cli.main import app

    app(prog_name="flywheel")


if __name__ == "__main__":
    main()
