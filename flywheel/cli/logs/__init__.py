"""Commands about logs of a robot."""
