"""Commands that drive to goals, and what drives."""
