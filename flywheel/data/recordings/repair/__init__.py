"""Repair of what trackers do to points: exchanged, jumping, strayed and repeated markers."""
