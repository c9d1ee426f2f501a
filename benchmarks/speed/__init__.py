"""How fast this machine plans, learns, simulates and stores: see `python -m benchmarks.speed --help`."""
