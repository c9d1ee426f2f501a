"""Commands that drive to goals, and their drivers."""
