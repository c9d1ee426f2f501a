"""Rigid bodies, cables and surfaces in torch, for the networks and for the rigid-body engine."""
