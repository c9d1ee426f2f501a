"""Speed of planning, learning, simulation and storage on this machine: see `python -m
benchmarks.speed --help`.
"""
