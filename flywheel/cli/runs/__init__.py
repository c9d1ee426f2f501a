"""Commands about runs of the flywheel."""
