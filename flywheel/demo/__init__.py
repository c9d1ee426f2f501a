"""A robot that is not its model: the story that `flywheel demo` plays, what came of it, and its page."""
