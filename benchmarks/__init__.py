"""What is measured of this project, beyond its tests. Each is run as `python -m benchmarks.NAME`, see --help.

- `diagnosis`: how often a diagnosis is right, on recordings of the truth simulator.
- `adoption`: from a hidden effect to a better network.
- `demo`: how `flywheel demo` ends, over all effects.
- `sysid`: a diagnosis beside fitting all of an MJCF's numbers with `mujoco.sysid`.
- `speed`: how fast this machine plans, learns, simulates and stores.
- `oracle`: how well MPPI does when its model is the plant itself.
- `regression`: whether what a user can measure is still the same after code was moved.
- `tables`: takes results over into results/*.csv, and makes the tables of docs/results/ from them.
"""
