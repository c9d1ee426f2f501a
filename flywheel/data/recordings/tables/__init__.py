"""A log as a table: its text, its columns in the words of the robot, and their values."""
