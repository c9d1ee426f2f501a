"""Whether what a user can measure is still the same: see `__main__`."""
