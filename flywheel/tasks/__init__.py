"""Tasks: goals, obstacles, and what a predicted motion costs."""
