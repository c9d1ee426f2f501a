"""`flywheel robot`: commands about one robot."""
