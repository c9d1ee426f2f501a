"""A check that measurable results are unchanged: see `__main__`."""
