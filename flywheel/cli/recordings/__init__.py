"""`flywheel recordings`: logs of real robots into a store, and episodes out of it."""
