"""Planes found in the clearest scan."""
