"""Several files joined into one recording: their clocks, names, poses and channels."""
