"""Benchmarks of this project, beyond its tests. Each is run as `python -m benchmarks.NAME`, see --help.

- `diagnosis`: how often a diagnosis is right, on recordings of the truth simulator.
- `adoption`: from a hidden effect to a better network.
- `demo`: outcomes of `flywheel demo`, over all effects.
- `sysid`: a diagnosis compared with fitting all of an MJCF's numbers with `mujoco.sysid`.
- `speed`: speed of planning, learning, simulation and storage on this machine.
- `oracle`: success of MPPI with the plant itself as model.
- `regression`: a check that measurable results are unchanged after code was moved.
- `tables`: imports results into results/*.csv, and makes the tables of docs/results/ from them.
"""
