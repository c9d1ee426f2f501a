"""The entry points: each module parses, builds from `flywheel.*`, calls, and shows."""
