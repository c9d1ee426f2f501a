"""The demonstration of `flywheel demo`: a robot that differs from its model, the outcome, and its page."""
